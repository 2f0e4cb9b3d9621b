"""hri-predict: forecasts the motion of people near a robot, and advises the robot.

The path of a frame: source -> people -> predictor -> risk -> publisher -> links. Each stage is a
subpackage that depends only on the contract of the next stage.

As a library, this module offers the few names in ``__all__``; ``docs/library.md`` has examples.
Each is loaded when it is first used, so ``import hri_predict`` is fast, and torch is imported only
when a trained predictor is requested. Everything else is imported from its own subpackage.

Units and frames everywhere: metres, seconds, radians, right-handed, z up; integer nanoseconds of
one clock for time.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING

from hri_predict.base import former_paths

__version__ = "0.3.0.dev0"
"""Version; the build reads it here."""

former_paths.install()

if TYPE_CHECKING:
    from hri_predict.base.errors import HriPredictError
    from hri_predict.base.skeleton import CANONICAL, Skeleton
    from hri_predict.contracts.joint_map import JointMap, load_joint_map
    from hri_predict.contracts.predictor import Forecast, Predictor
    from hri_predict.contracts.scene import Person, Scene
    from hri_predict.library.advisor import Advisor, load_config
    from hri_predict.library.forecasting import (
        RecordedForecast,
        forecast_at,
        forecasts,
        load_calibration_of,
        load_predictor,
    )
    from hri_predict.node.listeners import Tick
    from hri_predict.people.ring_buffer import PushResult, RingBuffer, Window
    from hri_predict.protocol.can import CanFrame, CanReceiver, CanSender
    from hri_predict.protocol.messages import (
        Acknowledge,
        Advice,
        Level,
        NodeState,
        RobotMode,
        RobotState,
        Status,
    )
    from hri_predict.protocol.reasons import Reason
    from hri_predict.protocol.serial import SerialReceiver, SerialSender
    from hri_predict.recording.opening import open_recording
    from hri_predict.recording.recording import Recording
    from hri_predict.run.config import Config

__all__ = [
    "CANONICAL",
    "Acknowledge",
    "Advice",
    "Advisor",
    "CanFrame",
    "CanReceiver",
    "CanSender",
    "Config",
    "Forecast",
    "HriPredictError",
    "JointMap",
    "Level",
    "NodeState",
    "Person",
    "Predictor",
    "PushResult",
    "Reason",
    "RecordedForecast",
    "Recording",
    "RingBuffer",
    "RobotMode",
    "RobotState",
    "Scene",
    "SerialReceiver",
    "SerialSender",
    "Skeleton",
    "Status",
    "Tick",
    "Window",
    "__version__",
    "forecast_at",
    "forecasts",
    "load_calibration_of",
    "load_config",
    "load_joint_map",
    "load_predictor",
    "open_recording",
]

_HOME = {  # module: the names that it lends; the same as above, for the interpreter
    "base.errors": "HriPredictError",
    "base.skeleton": "CANONICAL Skeleton",
    "contracts.joint_map": "JointMap load_joint_map",
    "contracts.predictor": "Forecast Predictor",
    "contracts.scene": "Person Scene",
    "library.advisor": "Advisor load_config",
    "library.forecasting": (
        "RecordedForecast forecast_at forecasts load_calibration_of load_predictor"
    ),
    "node.listeners": "Tick",
    "people.ring_buffer": "PushResult RingBuffer Window",
    "protocol.can": "CanFrame CanReceiver CanSender",
    "protocol.messages": "Acknowledge Advice Level NodeState RobotMode RobotState Status",
    "protocol.reasons": "Reason",
    "protocol.serial": "SerialReceiver SerialSender",
    "recording.opening": "open_recording",
    "recording.recording": "Recording",
    "run.config": "Config",
}

if not TYPE_CHECKING:  # a type checker must not take every unknown name for one of ours
    _MODULE_OF = {name: module for module, names in _HOME.items() for name in names.split()}

    def __getattr__(name):
        """Load a public name at its first use (PEP 562)."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'hri_predict' has no attribute '{name}'")
        value = getattr(import_module(f"hri_predict.{_MODULE_OF[name]}"), name)
        globals()[name] = value
        return value

    def __dir__():
        """List the public names, loaded or not."""
        return sorted({*globals(), *__all__})


if "HRI_PREDICT_OWN_PROCESS" in os.environ:  # before any library looks for its plug-ins
    import_module("hri_predict.base.installed").continue_tolerating()
