"""``evidence:`` in the configuration."""

from typing import Annotated, Literal

from pydantic import Field

from hri_predict.base.settings import Abbreviated

Kind = Literal["stop", "near_miss", "fault"]
KINDS: tuple[Kind, ...] = ("stop", "near_miss", "fault")


class EvidenceSettings(Abbreviated):
    """Settings of the evidence; a plain text is the folder."""

    folder: str = Field(min_length=1, description="folder for the files and evidence.jsonl")
    before_s: float = Field(5.0, ge=0.5, le=30, description="seconds kept before the event")
    after_s: float = Field(5.0, ge=0, le=30, description="seconds kept after the event")
    of: Annotated[list[Kind], Field(min_length=1)] = Field(
        list(KINDS), description="kinds of events whose seconds are kept; all are counted"
    )
    max_mb: float = Field(
        1000.0,
        ge=1,
        le=1e7,
        description="maximum size of all files; the oldest are deleted, and the deletion is logged",
    )
