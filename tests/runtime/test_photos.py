"""Photos that are slightly damaged, or of another mode, are read; what is cut off is not."""

import struct
import zlib
from io import BytesIO

import numpy as np
import pytest
from conftest import make_photo
from PIL import Image, ImageCms
from PIL.PngImagePlugin import PngInfo

from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.errors import UserError
from tex_lightning_runtime.photos import read_photo, to_rgb
from tex_lightning_runtime.pixels import as_pixels
from tex_lightning_runtime.runtime import decode

PHOTO = {"what": "photo", "medium": "photo", "least": 1, "half_scale": False, "limits": {}}
PIXELS = make_photo(1, 0)
RAMP = np.arange(0, 65536, 257 * 15, dtype=np.uint16).repeat(40).reshape(-1, 40)


def saved(path, image=None, cut=0, **options):
    (image or Image.fromarray(PIXELS)).save(path, **options)
    path.write_bytes(path.read_bytes()[: -cut or None])
    return path


def alike(path, expected):
    """Package and runtime read what is expected."""
    np.testing.assert_array_equal(PhotoDecoder(half_scale=False).decode(path)[0], expected)
    np.testing.assert_array_equal(decode(path, PHOTO).array, expected)


@pytest.mark.parametrize("quality", [60, 95])
@pytest.mark.parametrize("cut", [1, 2])
def test_a_jpeg_without_its_end_has_all_of_its_rows(tmp_path, quality, cut):
    whole = np.asarray(Image.open(saved(tmp_path / "whole.jpg", quality=quality)))
    path = saved(tmp_path / "a.jpg", quality=quality, cut=cut)
    photo, notes = read_photo(path)
    np.testing.assert_array_equal(photo, whole)
    assert notes == ["its end is missing"]
    alike(path, whole)


def test_what_is_missing_of_a_jpeg_is_counted_and_only_a_little_may_be(tmp_path):
    whole = np.asarray(Image.open(saved(tmp_path / "whole.jpg")))
    size = (tmp_path / "whole.jpg").stat().st_size
    photo, notes = read_photo(saved(tmp_path / "a.jpg", cut=40))
    lost = len(whole) - len(photo)
    assert 0 < lost <= 17
    np.testing.assert_array_equal(photo, whole[: len(photo)])
    assert notes == [f"its end is missing, and its last {lost} of 240 rows are left out"]
    for cut in (size // 5, size // 2, size - 700):
        with pytest.raises(UserError, match=r"truncated: \d+ of 240 rows are missing|damaged"):
            PhotoDecoder().decode(saved(tmp_path / "b.jpg", cut=cut))
    with pytest.raises(UserError, match="truncated"):  # every scan of a progressive one is of all
        read_photo(saved(tmp_path / "c.jpg", cut=size // 4, progressive=True))
    small = Image.fromarray(PIXELS[:40])
    with pytest.raises(UserError, match=r"truncated: (9|1\d) of 40 rows"):
        read_photo(saved(tmp_path / "d.jpg", small, cut=40))


def png_with(name: bytes, data: bytes, *, wrong_sum: bool = False) -> bytes:
    buffer = BytesIO()
    Image.fromarray(PIXELS).save(buffer, "PNG")
    content = buffer.getvalue()
    total = zlib.crc32(name + data) ^ wrong_sum
    chunk = len(data).to_bytes(4, "big") + name + data + total.to_bytes(4, "big")
    return content[:33] + chunk + content[33:]  # behind IHDR


@pytest.mark.parametrize(
    "content",
    [
        png_with(b"tEXt", b"Comment\0words", wrong_sum=True),
        png_with(b"zTXt", b"Comment\0\0nothing packed"),
        png_with(b"iCCP", b"profile\0\0nothing packed", wrong_sum=True),
        png_with(b"eXIf", b"nonsense"),
        png_with(b"tEXt", b"Raw profile type exif\0\nexif\n  9\nzz not hex\n"),
        png_with(b"pHYs", b"\0"),
    ],
    ids=["text", "packed", "profile", "exif", "exif text", "size"],
)
def test_a_png_with_damaged_texts_has_all_of_its_pixels(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    alike(tmp_path / "a.png", PIXELS)


def test_a_png_with_damaged_or_missing_pixels_is_refused(tmp_path):
    content = bytearray(png_with(b"tEXt", b"Comment\0words", wrong_sum=True))
    for wrong in (content[: len(content) // 2], content[:5000] + b"\0" + content[5001:]):
        (tmp_path / "a.png").write_bytes(wrong)
        with pytest.raises(UserError, match=r"damaged|no known format"):
            PhotoDecoder().decode(tmp_path / "a.png")


def test_transparency_is_said_and_the_colours_beneath_count(tmp_path):
    clear = np.dstack([PIXELS, np.where(PIXELS[..., 0] > 128, 255, 0).astype(np.uint8)])
    path = saved(tmp_path / "a.png", Image.fromarray(clear))
    assert read_photo(path)[1] == ["it is transparent in places, and the colours beneath count"]
    alike(path, PIXELS)
    palette = Image.fromarray(PIXELS).quantize(16)
    expected = np.asarray(palette.convert("RGB"))
    path = saved(tmp_path / "p.png", palette, transparency=3)
    assert len(read_photo(path)[1]) == 1
    alike(path, expected)
    alike(saved(tmp_path / "q.png", palette), expected)
    opaque = saved(tmp_path / "o.png", Image.fromarray(PIXELS).convert("RGBA"))
    assert read_photo(opaque)[1] == []


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_greys_of_16_bits_count_from_black_to_white_and_those_of_fewer_to_theirs(tmp_path, name):
    for values, white in ((RAMP, 65535), (RAMP >> 4, 4095), (RAMP >> 8, 255)):
        path = saved(tmp_path / name, Image.fromarray(values))
        expected = np.rint(values / white * 255).astype(np.uint8)
        alike(path, np.repeat(expected[..., None], 3, axis=2))
        assert read_photo(path)[1] == [f"its greys from 0 to {white:,} become 8 bits"]


def test_greys_whose_white_is_zero_are_turned_around(tmp_path):
    path = saved(tmp_path / "a.tif", Image.fromarray(65535 - RAMP))
    tag = struct.pack("<HHI", 262, 3, 1)  # and its value: how greys are meant
    path.write_bytes(path.read_bytes().replace(tag + b"\1", tag + b"\0"))
    alike(path, expected := np.repeat((RAMP // 257).astype(np.uint8)[..., None], 3, axis=2))
    np.testing.assert_array_equal(as_pixels(Image.open(path)), expected)


@pytest.mark.parametrize("order", ["<", ">"])
def test_planes_of_16_bits_are_no_noise(tmp_path, order):
    height, width = PIXELS.shape[:2]
    planes = np.moveaxis(PIXELS.astype(np.uint16) * 257, 2, 0).astype(f"{order}u2").tobytes()
    ends = 200 + len(planes) // 3 * np.arange(3)
    tags = {256: [width], 257: [height], 258: 3 * [16], 259: [1], 262: [2], 273: ends, 277: [3],
            278: [height], 279: 3 * [len(planes) // 3], 284: [2]}  # fmt: skip
    entries, behind, place = b"", b"", 8 + 2 + 12 * len(tags) + 4
    for tag, values in tags.items():
        data = struct.pack(f"{order}{len(values)}I", *values)
        inline = data if len(values) == 1 else struct.pack(f"{order}I", place + len(behind))
        behind += data if len(values) > 1 else b""
        entries += struct.pack(f"{order}HHI", tag, 4, len(values)) + inline
    head = b"II*\0" if order == "<" else b"MM\0*"
    head += struct.pack(f"{order}IH", 8, len(tags)) + entries + bytes(4) + behind
    (tmp_path / "a.tif").write_bytes(head.ljust(200, b"\0") + planes)
    alike(tmp_path / "a.tif", PIXELS)
    np.testing.assert_array_equal(as_pixels(Image.open(tmp_path / "a.tif")), PIXELS)


@pytest.mark.parametrize(("bits", "notes"), [(16, 0), (12, 1)])
def test_colours_of_12_bits_in_16_are_not_black(tmp_path, bits, notes):
    colours = (PIXELS.astype(np.uint16) * 257 >> 16 - bits).astype(">u2")
    rows = b"".join(b"\0" + row.tobytes() for row in colours)
    size = struct.pack(">IIBBBBB", *PIXELS.shape[1::-1], 16, 2, 0, 0, 0)
    content = b"\x89PNG\r\n\x1a\n"
    for name, data in ((b"IHDR", size), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")):
        check = struct.pack(">I", zlib.crc32(name + data))
        content += struct.pack(">I", len(data)) + name + data + check
    path = tmp_path / "a.png"
    path.write_bytes(content)
    photo, said = read_photo(path)
    assert abs(photo.astype(int) - PIXELS).max() <= 15 * notes
    assert len(said) == notes
    np.testing.assert_array_equal(as_pixels(Image.open(path)), photo)
    dark = saved(tmp_path / "b.png", Image.fromarray(PIXELS // 17))
    alike(dark, PIXELS // 17)


@pytest.mark.parametrize(
    ("name", "kind", "notes"), [("a.tif", "TIFF", 1), ("a.webp", "WEBP", 1), ("a.jpg", "MPO", 0)]
)
def test_that_the_first_page_of_several_is_read_is_said(tmp_path, name, kind, notes):
    pages = {"save_all": True, "append_images": [Image.fromarray(PIXELS[::-1].copy())]}
    path = saved(tmp_path / name, format=kind, **pages, **{} if kind == "TIFF" else {"quality": 95})
    photo, said = read_photo(path)
    assert abs(photo.astype(int) - PIXELS).mean() < 9
    assert said == notes * ["it has several pages or frames, and the first is read"]


def test_numbers_with_a_point_are_greys_or_refused(tmp_path):
    unit = np.linspace(0, 1, 400, dtype=np.float32).reshape(20, 20)
    for factor, white in ((1, 1), (255, 255), (65535, 65535)):
        photo, _ = read_photo(saved(tmp_path / "a.tif", Image.fromarray(unit * factor)))
        np.testing.assert_array_equal(photo[..., 0], np.rint(unit * factor * (255 / white)))
    for wrong in (unit - 0.5, unit * 1e6, unit * np.nan):
        with pytest.raises(UserError, match="greys are 0 to 65,535: save it with 8 bits"):
            PhotoDecoder().decode(saved(tmp_path / "b.tif", Image.fromarray(wrong)))


@pytest.mark.parametrize(
    "mode", ["P", "HSV", "LAB", "L", "1", "CMYK", "YCbCr", "RGBA", "LA", "I;16"]
)
def test_an_image_of_pillow_may_have_any_mode(mode):
    image = Image.fromarray(PIXELS)
    if mode == "LAB":
        profiles = ImageCms.createProfile("sRGB"), ImageCms.createProfile("LAB")
        given = ImageCms.profileToProfile(image, *profiles, outputMode="LAB")
    elif mode == "I;16":
        given = Image.fromarray(PIXELS[..., 0].astype(np.uint16) * 257)
    else:
        given = image.convert(mode)
    before = given.tobytes()
    photo = as_pixels(given)
    np.testing.assert_array_equal(decode(given, PHOTO).array, photo)
    grey = mode in ("L", "LA", "I;16")
    expected = np.asarray(image.convert("L").convert("RGB")) if grey and mode != "I;16" else PIXELS
    assert np.abs(photo.astype(int) - expected).mean() < {"1": 130, "P": 20}.get(mode, 4)
    assert (given.mode, given.tobytes()) == (mode, before)


def test_the_orientation_is_that_of_the_camera_or_left_out_where_it_is_damaged(tmp_path):
    turned = Image.Exif()
    turned[0x0112] = 6  # a quarter to the right
    path = saved(tmp_path / "a.png", exif=turned)
    alike(path, upright := np.rot90(PIXELS, -1))
    given = Image.open(path)
    for _ in range(2):  # it is not turned itself
        np.testing.assert_array_equal(as_pixels(given), upright)
    assert given.getexif()[0x0112] == 6
    texts = PngInfo()
    texts.add_text("Comment", "words")
    alike(saved(tmp_path / "b.png", pnginfo=texts), PIXELS)
    assert to_rgb(Image.fromarray(PIXELS))[1] == []


@pytest.mark.parametrize("mode", ["L", "P", "RGBA", "CMYK", "I;16"])
def test_a_turned_tiff_that_is_not_compressed_is_upright(tmp_path, mode):
    pixels = PIXELS[:, :-9]
    grey = Image.fromarray(pixels[..., 0].astype(np.uint16) * 257)
    given = grey if mode == "I;16" else Image.fromarray(pixels).convert(mode)
    given.save(tmp_path / "a.tif")
    given.save(tmp_path / "b.tif", tiffinfo={0x0112: 6})
    upright, turned = (read_photo(tmp_path / name)[0] for name in ("a.tif", "b.tif"))
    np.testing.assert_array_equal(turned, np.rot90(upright, -1))


def test_the_command_line_says_it_once_for_all_photos(cli, fused, surfaces, tmp_path):
    files = []
    for n in range(2):
        image = Image.open(surfaces / "beta" / "image" / f"beta_{n}.png")
        image.save(tmp_path / f"{n}.jpg", quality=95)
        content = (tmp_path / f"{n}.jpg").read_bytes()
        (tmp_path / f"{n}.jpg").write_bytes(content[:-2])
        files.append(str(tmp_path / f"{n}.jpg"))
    checkpoint = f"checkpoint={fused}/checkpoints/visual.ckpt"
    outcome = cli("task=predict", checkpoint, f"image=[{','.join(files)}]")
    assert (outcome.status, outcome.out.count("\n")) == (0, 2), outcome.err
    assert outcome.err.count("its end is missing") == 1
