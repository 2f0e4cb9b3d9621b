"""Description of the basis of a run's zones, for ``check``, ``run``, the 3D view and recordings."""

from hri_predict.run.assemble import build_calibration
from hri_predict.run.config import Config
from hri_predict.zones.settings import CoverageSettings


def zones_text(config: Config) -> str:
    """Describe the basis of the zones in one line, without claiming more than was measured."""
    risk, name = config.node.risk, config.predictor.name
    if not risk.uses_forecasts:
        return f"mode {risk.mode} uses no forecast"
    calibration = build_calibration(config)
    if calibration is None:
        return (
            f"not calibrated for {name} with these settings: how often zones contain people is "
            "unknown; see hri-predict calibrate"
        )
    coverage = risk.coverage
    held = "each joint" if coverage.of == "joint" else "the whole body"
    check = "checked live" if coverage.self_check else "not checked live"
    return (
        f"calibrated on {len(calibration.recordings)} recordings to hold {held} in "
        f"{100 * coverage.level:g} % ({coverage.basis}), {check}"
    )


def unused_coverage(config: Config) -> str:
    """Return a warning if ``risk.coverage`` is set but not used by the mode; otherwise ""."""
    risk = config.node.risk
    if risk.uses_forecasts or risk.coverage == CoverageSettings():
        return ""
    return (
        f"risk.coverage has no effect: mode {risk.mode} uses no forecast; "
        f"set mode: predictive or hybrid, or remove risk.coverage"
    )
