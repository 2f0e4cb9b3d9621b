"""``record:`` in the configuration."""

from pydantic import Field, model_validator

from hri_predict.base.settings import Abbreviated
from hri_predict.recording.mcap.items import Rates

_OF_FOLDERS = ("name", "max_minutes", "max_mb", "keep_days", "budget_gb", "min_free_gb")


class RecordSettings(Abbreviated):
    """A file's path, or a mapping with a ``folder`` whose files are managed automatically."""

    file: str | None = Field(
        None, min_length=1, description="single file, written until the disk is full"
    )
    folder: str | None = Field(None, min_length=1, description="folder of files by cell and time")
    name: str | None = Field(
        None,
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$",
        description="the cell's name; default: the configuration file's",
    )
    max_minutes: float = Field(60.0, ge=0.05, le=1440, description="maximum duration of one file")
    max_mb: float = Field(500.0, ge=1, le=100_000, description="maximum size of one file")
    keep_days: float | None = Field(
        None,
        ge=0.01,
        le=3650,
        description="files older than this are removed; default: only the budget applies",
    )
    budget_gb: float = Field(
        20.0,
        ge=0.001,
        le=1e6,
        description="total size of the cell's files; the oldest are removed first",
    )
    min_free_gb: float = Field(
        1.0, ge=0, le=1e6, description="stop recording when less than this many GB are free"
    )
    zones_hz: float = Field(5.0, ge=0, le=100, description="zones per second; 0: none")
    poses_hz: float = Field(5.0, ge=0, le=100, description="forecasts per second; 0: none")
    view_hz: float = Field(5.0, ge=0, le=100, description="pictures for 3D views; 0: none")
    sent: bool | None = Field(
        None, description="record the bytes that links wrote; default: only in a single file"
    )

    @model_validator(mode="after")
    def _one_place(self) -> "RecordSettings":
        if (self.file is None) == (self.folder is None):
            raise ValueError("name either a 'file' or a 'folder'")
        if self.file is not None:
            idle = [key for key in _OF_FOLDERS if key in self.model_fields_set]
            if idle:
                raise ValueError(f"{idle[0]} has no effect on a single file; name a 'folder'")
        elif self.budget_gb * 1000 < 2 * self.max_mb:
            raise ValueError(
                f"budget_gb {self.budget_gb:g} holds no two files of max_mb {self.max_mb:g}; "
                f"raise it, or lower max_mb"
            )
        return self

    @property
    def rates(self) -> Rates:
        """Recording rates of large data."""
        sent = self.folder is None if self.sent is None else self.sent
        return Rates(
            zones_hz=self.zones_hz, poses_hz=self.poses_hz, view_hz=self.view_hz, sent=sent
        )
