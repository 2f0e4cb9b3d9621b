"""The registry: parts found by name, third parties' among them."""

import importlib
import sys
from asyncio import CancelledError

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Settings
from hri_predict.contracts import registry
from hri_predict.predictors.ensemble import AverageSettings
from tests.packages import third_party as third_party_package


def test_shipped_parts_are_there_and_carry_their_settings():
    assert {"procedural", "recording"} <= set(registry.names("sources"))
    assert {"zero_velocity", "constant_velocity", "kalman"} <= set(registry.names("predictors"))
    assert {"serial", "can"} <= set(registry.names("links"))
    kinds: tuple[registry.PartKind, ...] = ("sources", "predictors", "links")
    for kind in kinds:
        assert registry.names(kind) == sorted(registry.names(kind))
        for name in registry.names(kind):
            assert issubclass(registry.load(kind, name).settings_model, Settings)


def test_an_unknown_name_is_told_the_nearest_and_all_there_are():
    with pytest.raises(ConfigError) as caught:
        registry.load("predictors", "kalmann")
    message = str(caught.value)
    assert "unknown predictor 'kalmann'" in message
    assert "did you mean 'kalman'?" in message
    assert "constant_velocity" in message
    assert "zero_velocity" in message
    assert "\n" not in message


@pytest.fixture
def third_party(tmp_path, monkeypatch):
    """Another package, with an entry point for a predictor, on the path."""
    third_party_package(
        tmp_path,
        "[hri_predict.predictors]\nbroken = other_people_s:Wonder\nwonder = good_people_s:Wonder\n"
        "bare = good_people_s:Bare\nnumber = good_people_s:NUMBER\nmodule = good_people_s\n"
        "quitting = quitting_people_s:Wonder\nnet = good_people_s:Net\n"
        "misnamed = good_people_s:Net\nmethodical = good_people_s:Methodical\n",
        other_people_s="import no_such_library_anywhere\n",
        good_people_s="from hri_predict.contracts.predictor import PredictorSettings\n"
        "class Wonder:\n    settings_model = PredictorSettings\n"
        "class Bare:\n    pass\n"
        "class Net(Wonder):\n    method, network_class = 'net', object\n"
        "class Methodical(Wonder):\n    method = 'least squares'\n"
        "NUMBER = 3\n",
        quitting_people_s="raise SystemExit(0)\n",
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    yield
    for name in ("other_people_s", "good_people_s"):
        sys.modules.pop(name, None)


@pytest.mark.usefixtures("third_party")
def test_third_parties_join_by_entry_point():
    assert "wonder" in registry.names("predictors")
    assert repr(registry.load("predictors", "wonder")) == "<class 'good_people_s.Wonder'>"


@pytest.mark.usefixtures("third_party")
def test_a_network_s_predictor_has_the_name_that_its_weights_will_state():
    assert repr(registry.load("predictors", "net")) == "<class 'good_people_s.Net'>"
    registry.load("predictors", "methodical")  # without a network, it may mean anything
    with pytest.raises(ConfigError) as caught:
        registry.load("predictors", "misnamed")
    assert str(caught.value) == (
        "predictor 'misnamed': its class Net has method = 'net', but its entry point is "
        "'misnamed'; give both the same name and install the package again"
    )


@pytest.mark.usefixtures("third_party")
def test_a_missing_library_is_named_and_harms_nobody_else():
    assert "broken" in registry.names("predictors")  # naming it imports nothing
    assert registry.load("predictors", "kalman") is not None
    with pytest.raises(ConfigError, match=r"no_such_library_anywhere.*install"):
        registry.load("predictors", "broken")


@pytest.mark.parametrize(
    ("name", "library", "extra"),
    [("websocket", "websockets.exceptions", "websocket"), ("zenoh", "zenoh", "fleet")],
)
def test_a_library_of_an_extra_is_told_with_its_extra(monkeypatch, name, library, extra):
    ours = ("hri_drivers.sources", "hri_drivers.wires")
    for loaded in [module for module in sys.modules if module.startswith(ours)]:
        monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ConfigError) as caught:
        registry.load("sources", name)
    assert library in str(caught.value)
    assert str(caught.value).endswith(f"; install it with: pip install 'hri-predict[{extra}]'")


def code_of(*names):
    return [registry.code_of_part("predictors", name) for name in names]


@pytest.mark.usefixtures("third_party")
def test_the_code_of_a_third_party_has_a_hash_that_any_change_changes(tmp_path):
    before = code_of("wonder", "broken")
    assert code_of("kalman", "nowhere") == [None, None]
    assert None not in before
    (tmp_path / "good_people_s.py").write_text("NUMBER = 4\n")
    after = code_of("wonder", "broken")
    assert after[0] != before[0]
    assert after[1] == before[1]  # another module
    assert "good_people_s" not in sys.modules  # nothing is imported


def test_any_module_of_a_package_counts(tmp_path, monkeypatch):
    third_party_package(tmp_path, "[hri_predict.predictors]\ndeep = whole_s.inner.part:Deep\n")
    inner = tmp_path / "whole_s" / "inner"
    inner.mkdir(parents=True)
    (inner / "part.py").write_text("")
    (tmp_path / "whole_s" / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    seen = [code_of("deep")]
    (tmp_path / "whole_s" / "helper.py").write_text("FACTOR = 2\n")
    seen.append(code_of("deep"))
    (tmp_path / "whole_s" / "__pycache__").mkdir()
    (tmp_path / "whole_s" / "__pycache__" / "helper.pyc").write_text("compiled")
    assert code_of("deep") == seen[1] != seen[0]


@pytest.mark.usefixtures("third_party")
def test_an_average_runs_the_code_of_its_members(tmp_path):
    def code(*members):
        return registry.code_of(AverageSettings(name="average", members=members))

    assert code("kalman", "constant_velocity") is None
    before = code("kalman", "wonder")
    (tmp_path / "good_people_s.py").write_text("NUMBER = 4\n")
    assert code("kalman", "wonder") != before


@pytest.mark.usefixtures("third_party")
@pytest.mark.parametrize("name", ["bare", "number", "module"])
def test_what_is_no_part_is_refused_in_one_line(name):
    with pytest.raises(ConfigError, match=rf"'{name}' is not a class .* PredictorSettings; fix"):
        registry.load("predictors", name)


@pytest.mark.usefixtures("third_party")
def test_a_module_that_exits_does_not_end_the_program():
    with pytest.raises(ConfigError, match=r"cannot be loaded: SystemExit: 0; fix"):
        registry.load("predictors", "quitting")


@pytest.mark.parametrize(
    "error", [RuntimeError("one\ntwo"), KeyError("x"), SystemExit(0), CancelledError()]
)
def test_a_part_that_cannot_be_built_is_told_in_one_line(error):
    with pytest.raises(ConfigError) as caught, registry.building("link 'x'"):
        raise error
    assert "link 'x' cannot be built: " + type(error).__name__ in str(caught.value)
    assert "\n" not in str(caught.value)
