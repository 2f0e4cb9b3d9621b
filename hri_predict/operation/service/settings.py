"""``log:`` and ``metrics:`` in the configuration."""

from typing import Literal

from pydantic import Field

from hri_predict.base.settings import Settings
from hri_predict.operation.service.logs import LINES_A_MINUTE


class LogSettings(Settings):
    """Settings of the node's log (standard error)."""

    format: Literal["text", "json"] = Field(
        "text", description="text: human-readable lines; json: one object per line, with UTC"
    )
    level: Literal["debug", "info", "warning", "error"] = Field(
        "warning", description="minimum severity of the lines written"
    )
    rate: int = Field(
        LINES_A_MINUTE,
        ge=1,
        le=60_000,
        description="lines per message and minute; further lines are counted, and the count is "
        "logged",
    )


class MetricsSettings(Settings):
    """Address at which the node serves /metrics (Prometheus) and /healthz, over HTTP."""

    port: int = Field(ge=1, le=65535, description="TCP port")
    host: str = Field(
        "127.0.0.1",
        min_length=1,
        max_length=253,
        description="address to listen on; default: only this machine",
    )
    healthy_periods: float = Field(
        5.0,
        ge=2,
        le=1000,
        description="/healthz returns 503 when the last tick is older than this number of periods "
        "of rate_hz",
    )
