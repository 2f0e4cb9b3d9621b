"""A TFLite or ONNX network from a file, behind one function."""

from collections.abc import Callable
from typing import Any

import numpy as np

from hri_drivers.camera.seen import Float32
from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import need_extra


class Net:
    """A network with one image as input.

    Attributes:
        shape: shape of the input, for one image.
        run: takes the input (float32), returns the outputs.
        names: names of the outputs.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        names: list[str],
        run: Callable[[Float32], list[Float32]],
    ) -> None:
        self.shape = shape
        self.names = names
        self.run = run


def load_net(content: bytes, where: str, threads: int = 1) -> Net:
    """Build a network.

    Args:
        content: content of a TFLite or ONNX file.
        where: the name of the network in errors.
        threads: maximum number of threads that compute it.

    Raises:
        ConfigError: the content is neither TFLite nor ONNX, is damaged, or does not take one image
            of float32.
    """
    build = _tflite if content[4:8] == b"TFL3" else _onnx
    if build is _tflite:
        need_extra("ai_edge_litert", "camera")
    try:
        net = build(content, threads)
    except ConfigError:
        raise
    except Exception as error:  # of every kind, from another's parser
        reason = " ".join(str(error).split())[:120]
        raise ConfigError(
            f"model {where}: not a TFLite or ONNX network that can be loaded ({reason}); give "
            f"another file"
        ) from error
    if net.shape[0] != 1:
        raise ConfigError(
            f"model {where}: the network takes {net.shape[0]} images at once; export it again with "
            f"a batch of 1"
        )
    return net


def _tflite(content: bytes, threads: int) -> Net:
    from ai_edge_litert.interpreter import Interpreter

    interpreter = Interpreter(model_content=content, num_threads=threads)
    interpreter.allocate_tensors()
    inputs, outputs = interpreter.get_input_details(), interpreter.get_output_details()
    shape = _picture_shape(
        [(tuple(map(int, i["shape"])), i["dtype"] == np.float32) for i in inputs]
    )

    def run(tensor: Float32) -> list[Float32]:
        interpreter.set_tensor(inputs[0]["index"], tensor)
        interpreter.invoke()
        return [_plain(interpreter.get_tensor(o["index"])) for o in outputs]

    return Net(shape, [str(o["name"]) for o in outputs], run)


def _onnx(content: bytes, threads: int) -> Net:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 4
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    inputs = session.get_inputs()
    shape = _picture_shape([(_fixed(i.shape), i.type == "tensor(float)") for i in inputs])

    def run(tensor: Float32) -> list[Float32]:
        return [_plain(each) for each in session.run(None, {inputs[0].name: tensor})]

    return Net(shape, [o.name for o in session.get_outputs()], run)


def _fixed(shape: list[Any]) -> tuple[int, ...]:
    """Return a shape with 1 for its batch and -1 for undefined sizes."""
    known = [size if isinstance(size, int) else -1 for size in shape]
    return (1 if known and known[0] == -1 else known[0], *known[1:]) if known else ()


def _picture_shape(inputs: list[tuple[tuple[int, ...], bool]]) -> tuple[int, ...]:
    if len(inputs) != 1 or len(inputs[0][0]) != 4 or not inputs[0][1]:
        raise ValueError("it must have one input: an image, four axes of float32")
    return inputs[0][0]


def _plain(output: Any) -> Float32:
    return np.asarray(output, np.float32)
