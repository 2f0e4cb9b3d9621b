"""A hint of another unit only proposes a number that the key accepts."""

import pytest
from pydantic import Field

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Settings, validated


class Block(Settings):
    margin_m: float = Field(0.0, ge=0, le=1)


@pytest.mark.parametrize(
    ("value", "end"), [(800, "metres are meant: 0.8?"), (1e6, "metres are meant")]
)
def test_a_number_that_fits_no_unit_gets_no_proposal(value, end):
    with pytest.raises(ConfigError) as error:
        validated(Block, {"margin_m": value}, "cell.yaml")
    assert str(error.value).endswith(end)
