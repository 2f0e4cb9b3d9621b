"""The COCO-17 person that docs/guides/live-sources.md shows stands upright in the room."""

from typing import Any

import numpy as np

from hri_predict.contracts.joint_map import load_joint_map
from tests import pages
from tests.pages import ROOT


def test_the_coco17_person_stands_where_the_canonical_one_does(monkeypatch):
    code = pages.named("coco17_person.py", ROOT / "docs" / "guides" / "live-sources.md").text
    monkeypatch.syspath_prepend(ROOT / "drivers" / "python")
    names: dict[str, Any] = {}
    exec(code.replace("range(1800)", "range(1)"), names)
    names["sender"].close()
    coco17 = load_joint_map("coco17")
    assert tuple(names["JOINTS"]) == coco17.source_joints
    sent = np.array([[np.nan] * 3 if at is None else at for at in names["coco17"](1.0)])
    places, seen = coco17.map(coco17.to_metres_z_up(sent), np.isfinite(sent).all(-1))
    assert seen.tolist() == coco17.mapped.tolist()
    wanted = np.array(names["swaying"](1.0))
    np.testing.assert_allclose(places[seen], wanted[seen], atol=0.06)  # the waist is at the hips
