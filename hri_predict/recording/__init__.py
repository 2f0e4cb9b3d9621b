"""Reading and writing motion files."""

from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.mcap.recorder import Recorder
from hri_predict.recording.opening import open_recording
from hri_predict.recording.recording import Recording, placed

__all__ = ["Recorder", "Recording", "RecordingInfo", "open_recording", "placed"]
