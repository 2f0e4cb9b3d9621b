"""``commissioning:`` in the configuration."""

from typing import Any

from pydantic import Field, model_validator

from hri_predict.settings import Settings


class CommissioningSettings(Settings):
    """Where the report is, or its path alone."""

    report: str = Field(
        min_length=1, description="report.json of hri-predict commission, or a folder of reports"
    )

    @model_validator(mode="before")
    @classmethod
    def _path_alone(cls, data: Any) -> Any:
        return {"report": data} if isinstance(data, str) else data
