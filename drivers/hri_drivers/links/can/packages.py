"""What a CAN interface of python-can needs to be installed, found without opening a device."""

import importlib
from importlib.util import find_spec

from can.interfaces import BACKENDS

from hri_drivers.links.can.settings import CanLinkSettings
from hri_predict.errors import LinkError


def demand_packages(settings: CanLinkSettings) -> None:
    """Refuse a link whose interface lacks a package here.

    Raises:
        LinkError: names the link, what is missing and the remedy.
    """
    interface = settings.interface
    where = f"link '{settings.name}': CAN interface {interface}"
    # python-can imports this one lazily: it would be missed only when the bus opens
    if interface == "udp_multicast" and find_spec("msgpack") is None:
        raise LinkError(f"{where} needs msgpack; install it with: pip install 'hri-predict[udp]'")
    module, _ = BACKENDS.get(interface, ("can", ""))
    try:
        importlib.import_module(module)
    except Exception as error:  # vendors' drivers raise anything
        raise LinkError(
            f"{where}: its driver is not available ({error}); install it, or choose another "
            f"interface"
        ) from error
