"""Networks by a description: worked examples with small ONNX networks."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from hri_drivers.camera.network.described import Description
from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from tests import pages
from tests.hri_drivers.camera.pictures import cv2

from hri_drivers.camera.network.described import DescribedNetwork  # isort: skip

onnx = pytest.importorskip("onnx")
helper = onnx.helper

SIDE, CELL = 64, 4
WITHIN = 2 * CELL * 640 / SIDE / 2
"""Of the picture: a map's place is a cell of 4 pixels of the network, 40 of the picture; the disc
covers several cells that are equally bright."""


def save(path: Path, nodes, outputs, constants=(), shape=(1, 3, SIDE, SIDE)) -> Path:
    graph = helper.make_graph(
        nodes,
        "test",
        [helper.make_tensor_value_info("picture", onnx.TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info(n, onnx.TensorProto.FLOAT, s) for n, s in outputs],
        [onnx.numpy_helper.from_array(np.asarray(a), n) for n, a in constants],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, str(path))
    return path


def colour_maps(path: Path) -> Path:
    """COCO's 17 joints as maps: even joints are where it is red, odd ones where it is blue."""
    weights = np.full((17, 3, 1, 1), -1.0, np.float32)
    weights[0::2, 0] = weights[1::2, 2] = 1.0
    nodes = [
        helper.make_node("AveragePool", ["picture"], ["small"], kernel_shape=[CELL] * 2,
                         strides=[CELL] * 2),
        helper.make_node("Conv", ["small", "weights"], ["maps"]),
    ]  # fmt: skip
    cells = SIDE // CELL
    return save(path, nodes, [("maps", (1, 17, cells, cells))], [("weights", weights)])


def fixed_rows(path: Path, rows: np.ndarray, name: str = "rows") -> Path:
    """A network that has these rows for every picture."""
    nodes = [
        helper.make_node("ReduceMean", ["picture"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "fixed"], [name]),
    ]
    constants = [("zero", np.float32(0)), ("fixed", rows.astype(np.float32))]
    return save(path, nodes, [(name, rows.shape)], constants)


def describe(folder: Path, most: int = 4, **description) -> DescribedNetwork:
    path = folder / "net.yaml"
    path.write_text(yaml.safe_dump({"network": "net.onnx", "layout": "coco17"} | description))
    return DescribedNetwork(path, most)


NCHW = {"order": "nchw"}


def test_heat_maps_of_a_real_picture(tmp_path):
    colour_maps(tmp_path / "net.onnx")
    network = describe(tmp_path, input=NCHW, joints={"heatmaps": True})
    picture = np.zeros((480, 640, 3), np.uint8)
    cv2.circle(picture, (200, 120), 40, (0, 0, 255), -1)  # red, in BGR
    cv2.circle(picture, (480, 380), 40, (255, 0, 0), -1)
    finding = network.find(picture)
    assert not finding.is_whole  # maps of one person show no second one
    (person,) = finding.people
    np.testing.assert_allclose(person.pixels[0::2], [[200, 120]] * 9, atol=WITHIN)
    np.testing.assert_allclose(person.pixels[1::2], [[480, 380]] * 8, atol=WITHIN)
    assert person.world is None
    assert network.find(np.zeros((480, 640, 3), np.uint8)).people == ()


def test_swapped_colours_are_other_joints(tmp_path):
    colour_maps(tmp_path / "net.onnx")
    network = describe(tmp_path, input=NCHW | {"channels": "bgr"}, joints={"heatmaps": True})
    picture = np.zeros((640, 640, 3), np.uint8)
    cv2.circle(picture, (200, 120), 60, (0, 0, 255), -1)
    cv2.circle(picture, (480, 380), 60, (255, 0, 0), -1)
    (person,) = network.find(picture).people
    np.testing.assert_allclose(person.pixels[0], [480, 380], atol=WITHIN)


def row(x, y, score):
    """A person in the layout of YOLO: a box, a score, and 17 times x, y, score."""
    joints = [[x + k, y + 2 * k, 0.8] for k in range(17)]
    return [x, y, 10, 20, score, *np.ravel(joints)]


def test_people_in_columns_with_scores_of_their_own(tmp_path):
    rows = np.array([row(10, 12, 0.9), row(10.2, 12, 0.7), row(40, 12, 0.6), row(50, 5, 0.1)])
    fixed_rows(tmp_path / "net.onnx", rows.T[np.newaxis])
    people = {"output": "rows", "along": "columns", "first": 5, "score": 4}
    network = describe(tmp_path, input=NCHW, people=people)
    finding = network.find(np.zeros((640, 640, 3), np.uint8))
    assert [round(p.score, 2) for p in finding.people] == [0.9, 0.6]  # one twice, one too unsure
    # a pixel of the network is 10 of the picture, and its centre a whole number
    np.testing.assert_allclose(finding.people[0].pixels[0], [10.5 * 10 - 0.5, 12.5 * 10 - 0.5])
    assert (
        not describe(tmp_path, 1, input=NCHW, people=people)
        .find(np.zeros((640, 640, 3), np.uint8))
        .is_whole
    )


def test_when_all_of_the_output_is_taken_there_may_be_more_people(tmp_path):
    nothing = np.zeros((640, 640, 3), np.uint8)
    people = {"along": "columns", "first": 5, "score": 4}
    for rows, is_whole in (
        ([row(10, 12, 0.9)], False),  # a network that looks for one person
        ([row(10, 12, 0.9), row(40, 12, 0.6)], False),
        ([row(10, 12, 0.9), row(40, 12, 0.1)], True),
        ([row(10, 12, 0.1)], True),
    ):
        fixed_rows(tmp_path / "net.onnx", np.array(rows).T[np.newaxis])
        finding = describe(tmp_path, input=NCHW, people=people).find(nothing)
        assert finding.is_whole == is_whole


def test_fractions_in_another_order_as_movenet_has_them(tmp_path):
    joints = np.zeros((1, 1, 17, 3))
    joints[..., 0], joints[..., 1], joints[..., 2] = 0.5, 0.25, 0.9  # y, x, score
    joints[..., 3, 2] = np.nan
    fixed_rows(tmp_path / "net.onnx", joints)
    values = {"values": ["y", "x", "score"], "units": "fraction"}
    network = describe(tmp_path, input=NCHW, joints=values, people={"least": 0.2})
    assert network.find(np.zeros((480, 640, 3), np.uint8)).people == ()  # a score is not a number
    joints[..., 3, 2] = 0.9
    fixed_rows(tmp_path / "net.onnx", joints)
    network = describe(tmp_path, input=NCHW, joints=values)
    (person,) = network.find(np.zeros((480, 640, 3), np.uint8)).people
    np.testing.assert_allclose(person.pixels[5], [159.5, 239.5])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"layout": "coco18"}, "layout"),
        ({"network": "missing.onnx"}, "missing.onnx: cannot be read"),
        ({"network": "net.yaml"}, "not a TFLite or ONNX network"),
        ({"people": {"output": "boxes"}}, "no output 'boxes'"),
        ({"people": {"first": 6}}, "a person has 56 values, expected 57 or more"),
        ({"input": {"order": "nhwc"}}, "set the other order"),
        ({"input": NCHW | {"side": 128}}, "match input.side"),
        ({"joints": {"values": ["x", "score"]}}, "must name x and y"),
        ({"joints": {"values": ["x", "y"]}}, "give people.score"),
        ({"joints": {"heatmaps": True}}, "expected 17 maps"),
        ({"people": {"world": "rows"}}, "does not fit the description"),
        ({"input": {"scale": 0}}, "scale"),
        ({"depth": 1}, "depth"),
    ],
)
def test_a_wrong_description_is_one_line(changes, message, tmp_path):
    rows = np.zeros((1, 56))
    fixed_rows(tmp_path / "net.onnx", rows)
    with pytest.raises(ConfigError) as caught:
        describe(tmp_path, **({"input": NCHW} | changes))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


FREE = (1, 3, "height", "width")


@pytest.mark.parametrize("batch", [4, 0])
def test_a_network_for_several_images_at_once_is_refused(batch, tmp_path):
    nodes = [helper.make_node("Identity", ["picture"], ["same"])]
    shape = (batch, 3, SIDE, SIDE)
    save(tmp_path / "net.onnx", nodes, [("same", shape)], shape=shape)
    with pytest.raises(ConfigError, match=r"takes .* images at once.*export it .* batch") as caught:
        describe(tmp_path, input=NCHW)
    assert "\n" not in str(caught.value)


def test_an_undefined_batch_is_one_image(tmp_path):
    cells = SIDE // CELL
    colour_maps(tmp_path / "net.onnx")
    model = onnx.load(tmp_path / "net.onnx")
    for value in (model.graph.input[0], model.graph.output[0]):
        value.type.tensor_type.shape.dim[0].dim_param = "batch"
    onnx.save(model, tmp_path / "net.onnx")
    network = describe(tmp_path, input=NCHW, joints={"heatmaps": True})
    assert network.find(np.zeros((cells, cells, 3), np.uint8)).people == ()


def test_a_side_that_the_network_cannot_compute_is_one_line(tmp_path):
    """It accepts every size, but its matrix fits one only."""
    nodes = [
        helper.make_node("Flatten", ["picture"], ["flat"]),
        helper.make_node("MatMul", ["flat", "weights"], ["rows"]),
    ]
    weights = np.zeros((3 * SIDE * SIDE, 51), np.float32)
    save(tmp_path / "net.onnx", nodes, [("rows", (1, 51))], [("weights", weights)], FREE)
    assert describe(tmp_path, input=NCHW | {"side": SIDE}).layout == "coco17"
    with pytest.raises(ConfigError, match=r"cannot compute .*input\.side") as caught:
        describe(tmp_path, input=NCHW | {"side": 2 * SIDE})
    assert "\n" not in str(caught.value)


def test_the_guide_shows_a_description():
    (block,) = [b for b in pages.blocks("yaml") if b.text.startswith("network:")]
    shown = validated(Description, yaml.safe_load(block.text), block.page.name)
    assert shown.layout == "mediapipe33"
    assert shown.people.world == "metres"
