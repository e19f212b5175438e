"""What libraries say of damaged files stays inside, and nothing else does."""

import warnings
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest
from PIL import Image

from tex_lightning.core.console import suppress_warnings
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.errors import UserError


def test_many_threads_keep_warnings_in_and_leave_the_filters_as_they_were():
    barrier = Barrier(4)

    def read(_):
        with suppress_warnings():
            barrier.wait()
            warnings.warn("inside", UserWarning, stacklevel=1)
            barrier.wait()

    before = list(warnings.filters)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(read, range(4)))
    assert warnings.filters == before
    with pytest.warns(UserWarning, match="outside"):
        warnings.warn("outside", UserWarning, stacklevel=1)


def test_a_damaged_tiff_is_told_by_us_alone(tmp_path, capfd):
    path = tmp_path / "a.tif"
    Image.fromarray(np.zeros((48, 40, 3), np.uint8)).save(path, compression="tiff_lzw")
    content = bytearray(path.read_bytes())
    content[8:20] = b"\xff" * 12
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"a.tif is damaged \(.*\); replace the file\.$"):
        PhotoDecoder().decode(path)
    assert capfd.readouterr() == ("", "")
