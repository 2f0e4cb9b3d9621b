"""A source that fails on the virtual clock ends the run with one line."""

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.run.runtime import run_virtual
from tests.hri_predict.run.fakes import Source, make


@pytest.mark.parametrize("error", [ZeroDivisionError("by zero\nat x"), SystemExit("no file")])
@pytest.mark.parametrize("method", ["open", "next_ns", "poll"])
def test_a_source_that_raises_ends_the_run_with_one_line(method, error):
    def fails(*_):
        raise error

    source = Source(count=7)
    setattr(source, method, fails)
    with pytest.raises(ConfigError) as caught:
        run_virtual(make(source=source, virtual=True))
    said, *more = str(caught.value).splitlines()
    assert said.startswith("source 'own' failed: ")
    assert str(error).splitlines()[0] in said
    assert "correct it" in said
    assert more == []


def test_the_node_s_own_mistake_is_not_blamed_on_the_source():
    assembly = make(virtual=True)
    assembly.node.receive = lambda *_: 1 / 0
    with pytest.raises(ZeroDivisionError):
        run_virtual(assembly, duration_s=0.1)
