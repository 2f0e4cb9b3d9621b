"""Packages that a CAN interface of python-can needs, found without opening a device."""

import ctypes
import importlib
import sys
from collections.abc import Iterable
from ctypes.util import find_library
from importlib.util import find_spec

import can
from can.interfaces import BACKENDS

from hri_predict.base.errors import LinkError

_KERNEL = "or use interface socketcan: Linux has a driver for these adapters"
_WINDOWS = "which exists for Windows only; choose another interface"
_NEEDS = {
    "canalystii": "the package canalystii; install it with: pip install 'python-can[canalystii]'",
    "cantact": "the package cantact; install it with: pip install 'python-can[cantact]'",
    "etas": f"ETAS's BOA, {_WINDOWS}",
    "gs_usb": "the package gs_usb; install it with: pip install 'python-can[gs-usb]', " + _KERNEL,
    "iscan": "Thorsis's driver iscandrv; install it",
    "ixxat": f"HMS's VCI driver, {_WINDOWS}",
    "kvaser": f"Kvaser's library CANlib; install Kvaser's linuxcan or its drivers, {_KERNEL}",
    "neousys": "Neousys's library WDT_DIO; install its driver",
    "neovi": "the package python-ics; install it with: pip install 'python-can[neovi]'",
    "nican": f"NI-CAN, {_WINDOWS}",
    "nixnet": f"NI-XNET, {_WINDOWS}",
    "pcan": f"PEAK's library PCAN-Basic; install it from PEAK-System's driver package, {_KERNEL}",
    "systec": f"SYSTEC's USB-CANmodul driver, {_WINDOWS}",
    "usb2can": f"8devices's library, {_WINDOWS}",
    "vector": f"Vector's XL Driver Library, {_WINDOWS}",
}
"""Driver, library or package of each interface that python-can does not include."""


def demand_packages(name: str, interface: str) -> None:
    """Refuse a link if this machine lacks a package or library of its interface.

    Args:
        name: the link's name.
        interface: python-can's name.

    Raises:
        LinkError: the message names the link, the missing part and the remedy.
    """
    where = f"link '{name}': CAN interface {interface}"
    # python-can imports this one lazily: it would be missed only when the bus opens
    if interface == "udp_multicast" and find_spec("msgpack") is None:
        raise LinkError(f"{where} needs msgpack; install it with: pip install 'hri-predict[udp]'")
    module, _ = BACKENDS.get(interface, ("can", ""))
    try:
        importlib.import_module(module)
    except Exception as error:  # vendors' drivers raise anything
        raise LinkError(f"{where}: {_missing(interface, error)}") from error
    if _lacks_library(interface):
        raise LinkError(f"{where}: {_missing(interface)}")


def missing_driver(interface: str, chain: Iterable[BaseException]) -> str | None:
    """Return the missing package and the remedy, if a missing package kept a bus from opening.

    Args:
        interface: python-can's name.
        chain: the error and its causes.
    """
    for error in chain:
        if "msgpack" in str(error):
            return "needs msgpack; install it with: pip install 'hri-predict[udp]'"
        absent = isinstance(error, can.CanInterfaceNotImplementedError | ImportError)
        # Kvaser's module lacks its functions (NameError), PEAK's raises OSError, others their own
        text = str(error).lower()
        vendors = interface in _NEEDS and (
            isinstance(error, NameError | AttributeError)
            or "library not found" in text
            or "could not be loaded" in text
            or "shared object" in text
        )
        if absent or vendors:
            return _missing(interface, error)
    return None


def _missing(interface: str, error: BaseException | None = None) -> str:
    said = "" if error is None else f" ({str(error).splitlines()[0] if str(error) else 'absent'})"
    needs = _NEEDS.get(interface)
    if needs is None:
        return f"its driver is not available{said}; install it, or choose another interface"
    return f"its driver is not available{said}: it needs {needs}"


def _lacks_library(interface: str) -> bool:
    """Whether a library is missing that python-can, on Linux, loads only to open the bus."""
    if not sys.platform.startswith("linux"):
        return False
    if interface == "pcan":
        return find_library("pcanbasic") is None
    if interface != "kvaser":
        return False
    try:
        ctypes.cdll.LoadLibrary("libcanlib.so")
    except OSError:
        return True
    return False
