"""Reading and writing motion files."""

from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.mcap.messages import Moment, Told, moment, read_messages, recording_info
from hri_predict.recording.mcap.recorder import Recorder
from hri_predict.recording.opening import open_recording
from hri_predict.recording.recording import Recording, placed

__all__ = [
    "Moment",
    "Recorder",
    "Recording",
    "RecordingInfo",
    "Told",
    "moment",
    "open_recording",
    "placed",
    "read_messages",
    "recording_info",
]
