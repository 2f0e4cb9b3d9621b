"""Common parts of plots: matplotlib (or one line that says how to get it), colours, writing PNG
files.

The colours are those of M. Okabe and K. Ito, "Color universal design" (2008), which the
colour-blind can tell apart.
"""

import io
from pathlib import Path

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import atomic_write

try:
    from matplotlib.figure import Figure
    from PIL import Image  # matplotlib writes its PNG by Pillow, so it is there
except ImportError as error:  # an extra of its own
    raise ConfigError(
        "plots need matplotlib; install it with pip install 'hri-predict[train]'"
    ) from error

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C564B", "#000000")
README_INCHES = 9.0
"""Width of a figure that is read at 900 pixels or so: text of 8 points and more is legible."""
README_DPI = 200
_PALETTE = 128  # colours in a file: a third of its size, and nobody sees the difference


def write_png(figure: Figure, path: Path, dpi: int = README_DPI) -> Path:
    """Write a figure whole or not at all; makes the folder.

    Raises:
        ConfigError: it cannot be written; a file that was there is as it was.
    """
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, dpi=dpi, format="png")
    image = Image.open(drawn).convert("RGB").quantize(_PALETTE, dither=Image.Dither.NONE)
    image.save(small, "PNG", optimize=True)
    try:
        atomic_write(path, small.getvalue())
    except OSError as error:
        raise ConfigError(
            f"{path}: cannot be written: {error.strerror}; name another folder"
        ) from error
    return path
