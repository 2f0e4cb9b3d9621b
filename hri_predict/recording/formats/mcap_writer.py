"""Writes a recording as the node's own MCAP, which states the frame of its scenes."""

from collections import deque
from pathlib import Path

from hri_predict.base.errors import RecordingError
from hri_predict.recording.bounded import WRITING, watched
from hri_predict.recording.cutting import people_of
from hri_predict.recording.frames import Written
from hri_predict.recording.mcap.clocks import VirtualClocks
from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.mcap.places import OneFile
from hri_predict.recording.mcap.recorder import Recorder
from hri_predict.recording.recording import Recording


def write_mcap(path: Path, recording: Recording) -> Written:
    """Write every scene exactly as it arrived, and the messages of the controllers.

    Raises:
        RecordingError: it cannot be written.
    """
    info = RecordingInfo(
        joint_map=recording.joint_map,
        rate_hz=recording.rate_hz,
        declares_noise=recording.declares_noise,
        config=recording.config,
        in_room=recording.in_room,
        last_latch_id=recording.last_latch_id,
    )
    written = Written(len(recording.scenes), people_of(recording))
    start_ns = recording.arrival_ns[0]
    offset_ns = recording.utc_ns[0] - start_ns if recording.utc_ns else None
    clocks = VirtualClocks(start_ns, offset_ns)
    told = deque(sorted(recording.received, key=lambda r: r[1].received_ns))
    with Recorder(OneFile(path, overwrite=True), info, threaded=False, clocks=clocks) as recorder:
        scenes = watched(recording.scenes, WRITING, len(recording.scenes))
        for scene, arrival_ns in zip(scenes, recording.arrival_ns, strict=True):
            while told and told[0][1].received_ns <= arrival_ns:
                recorder.on_received(*told.popleft())
            recorder.on_scene(scene, arrival_ns)
        for link, received in told:
            recorder.on_received(link, received)
    if recorder.error is not None or recorder.dropped:
        raise RecordingError(
            f"recording {path}: cannot be written: {recorder.error or 'a scene is not JSON'}"
        )
    if recording.kind == "mcap":
        written.notes.append("the node's output is left out, because a replay computes it")
    return written
