"""The page of one cell. Run by ``feed``: ``python -m hri_predict.viewing.operator.page``."""

from hri_predict.viewing.operator.server import serve
from hri_predict.viewing.operator.state import State

if __name__ == "__main__":
    serve(State(), "page")
