"""What a run says of the basis of its zones."""

from hri_predict.run import config as configuration
from hri_predict.run.coverage import zones_text


def test_the_share_that_zones_hold_is_in_per_cent():
    text = zones_text(configuration.load(configuration.shipped("demo.yaml")))
    assert "to hold each joint in 99 % (estimated), checked live" in text
