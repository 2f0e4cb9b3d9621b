"""The newest image of an input; older ones that were never used are counted."""

import threading
import time
from dataclasses import replace

from hri_drivers.camera.images import Input
from hri_drivers.camera.seen import Image
from hri_drivers.wires.backoff import BackOff
from hri_predict.base.errors import HriPredictError


class Newest:
    """Reads an input in a separate thread.

    Args:
        pictures: the input; the thread closes it.

    Attributes:
        dropped: number of images that a newer one replaced before they were used.
        interruptions: number of times that the input had no image.
        trouble: why no image arrives now; None: one arrived, or the first is still awaited.
        ended: whether the input has ended.
    """

    def __init__(self, pictures: Input) -> None:
        self._input = pictures
        self._changed = threading.Condition()
        self._image: Image | None = None
        self._stopping = False
        self.dropped = self.interruptions = 0
        self.trouble: str | None = None
        self.ended = False
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    @property
    def stamps(self) -> str:
        """See ``Input``."""
        return self._input.stamps

    def take(self, timeout_s: float) -> Image | None:
        """Wait for the newest image and return it once; None if no image arrives in time.

        If the input's ``waits`` is true, the exposure time is set to now.

        Raises:
            Exception: the input failed with an error other than its own.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._image is not None or self.ended, timeout_s)
            image, self._image = self._image, None
            self._changed.notify_all()
            if image is None and self._failure is not None:
                raise self._failure
            if image is not None and self._input.waits:
                return replace(image, exposed_ns=time.monotonic_ns())
            return image

    def close(self, timeout_s: float = 1.0) -> None:
        """Stop the thread; it is abandoned if its device does not return in time."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        back_off = BackOff()
        try:
            while not self._stopping and self._step(back_off):
                pass
        except Exception as error:
            self._failure = error
        finally:
            with self._changed:
                self.ended = True
                self._changed.notify_all()
            self._input.close()

    def _step(self, back_off: BackOff) -> bool:
        """Read one image; return whether there may be another."""
        try:
            image = self._input.read()
        except HriPredictError as error:
            with self._changed:
                self.interruptions += 1
                self.trouble = str(error)
                self._changed.notify_all()
                wait_s = back_off.next_s(time.monotonic_ns())
                self._changed.wait_for(lambda: self._stopping, wait_s)
            return True
        if image is None:
            return False
        if self.trouble is not None:
            back_off.opened(time.monotonic_ns())
        with self._changed:
            if self._input.waits:
                self._changed.wait_for(lambda: self._image is None or self._stopping)
            self.dropped += self._image is not None
            self._image, self.trouble = image, None
            self._changed.notify_all()
        return True
