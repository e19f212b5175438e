"""Photos of a camera, or of another source that OpenCV reads."""

import cv2
import numpy as np
import numpy.typing as npt

from tex_lightning.errors import UserError

Pixels = npt.NDArray[np.uint8]  # (height, width, 3), colours as OpenCV has them: BGR

FIRST = 5  # pictures that are passed over: exposure settles, and older ones wait in the driver
QUALITY = 95  # of JPEG, 0 to 100


class Camera:
    """One camera, open until :meth:`close`.

    Args:
        given: ``camera:NUMBER``, or the path or address of a photo, a video or numbered photos
            (``p_%02d.png``), which are gone through one by one.

    Raises:
        UserError: If it cannot be opened.
    """

    def __init__(self, given: str) -> None:
        self.name = f"image={given}"
        kind, _, number = given.partition(":")
        self.live = kind == "camera"
        if self.live and not number.isdecimal():
            raise UserError(f"{self.name} names no camera; write camera:0, camera:1 and so on.")
        before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            self._capture = cv2.VideoCapture(int(number) if self.live else given)
        finally:
            cv2.utils.logging.setLogLevel(before)
        if not self._capture.isOpened():
            raise UserError(f"{self.name} cannot be opened; {self._remedy}.")

    @property
    def _remedy(self) -> str:
        if self.live:
            return (
                "check that the camera is plugged in and no other program has it, or give another "
                "number, such as camera:1"
            )
        return "check the path, or give camera:0"

    def photo(self) -> Pixels:
        """What it sees now.

        Raises:
            UserError: If it gives no picture.
        """
        for _ in range(FIRST if self.live else 0):
            self._capture.grab()
        there, picture = self._capture.read()
        if not there:
            raise UserError(f"{self.name} gives no picture (any more); {self._remedy}.")
        return np.asarray(picture, np.uint8)

    def close(self) -> None:
        """Leave it to other programs."""
        self._capture.release()


def encode(photo: Pixels) -> bytes:
    """A photo as the content of a JPEG file."""
    _, content = cv2.imencode(".jpg", photo, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))
    return content.tobytes()
