"""The page of many cells. Run by ``fleet_feed``: ``python -m ...viewing.operator.fleet``."""

from hri_predict.viewing.operator.fleet_state import FleetState
from hri_predict.viewing.operator.server import serve

if __name__ == "__main__":
    serve(FleetState(), "fleet")
