"""``commissioning:`` in the configuration."""

from pydantic import Field

from hri_predict.base.settings import Abbreviated


class CommissioningSettings(Abbreviated):
    """Place of the report, or its path alone."""

    report: str = Field(
        min_length=1, description="report.json of hri-predict commission, or a folder of reports"
    )
