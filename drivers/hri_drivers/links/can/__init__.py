"""The CAN link, classic and FD."""

import logging

# python-can logs lines of its own, some thousands a second; a LinkError says what there is to say.
_log = logging.getLogger("can")
_log.addHandler(logging.NullHandler())
_log.setLevel(logging.CRITICAL)
_log.propagate = False
