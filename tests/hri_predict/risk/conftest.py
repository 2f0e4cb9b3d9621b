from tests.hri_predict.zones.conftest import make_calibration

__all__ = ["make_calibration"]
