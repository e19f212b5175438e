"""XML traces against the numbers they were written from."""

from pathlib import Path

import numpy as np
import pytest

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.errors import UserError

SAMPLES = np.random.default_rng(0).standard_normal((3, 200)).round(4)
RATE = "<SampleRate>10000</SampleRate>"


def axis(name: str, values, *, between: str = " ") -> str:
    return f"<{name}>{between.join(map(str, values))}</{name}>"


def axes(*names: str) -> str:
    return "".join(axis(name, values) for name, values in zip(names, SAMPLES, strict=True))


def write(tmp_path: Path, content: str, head: str = '<?xml version="1.0"?>') -> Path:
    path = tmp_path / "Foam_Recording1.xml"
    path.write_text(f"{head}\n<RecordedData>{content}</RecordedData>", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "content",
    [
        RATE + axes("AccelX", "AccelY", "AccelZ") + axis("ForceX", [1, 2]) + axis("Speed", "ab"),
        f"<d:a xmlns:d='urn:a'>{RATE}{axes('ACCELX', 'accely', 'd:AccelZ')}</d:a>",
        (RATE + axes("AccelX", "AccelY", "AccelZ")).replace(" ", ";\n"),
    ],
    ids=["flat", "names", "marks"],
)
def test_layouts_give_the_same_samples(tmp_path, content):
    trace, source = SignalDecoder().decode(write(tmp_path, content))
    np.testing.assert_allclose(trace, SAMPLES, rtol=1e-6)
    assert (source.hz, source.source) == (10_000, "header")


ENTITIES = '<!DOCTYPE a [<!ENTITY a "1 1"><!ENTITY b "&a;&a;">]>'
XYZ = axes("AccelX", "AccelY", "AccelZ")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (XYZ, "it needs one SampleRate .* but has 0 and 200, 200, 200"),
        ("<SampleRate>fast</SampleRate>" + XYZ, "could not convert string to float: .*'fast'"),
        (RATE + XYZ.replace("AccelY", "AccelW"), "but has 1 and 200, 0, 200"),
        (RATE + XYZ.replace("</AccelZ>", ""), "mismatched tag"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, content, message):
    with pytest.raises(UserError, match=f"Trace .*xml cannot be read .*{message}"):
        SignalDecoder().decode(write(tmp_path, content))


def test_a_truncated_file_and_entities_are_refused(tmp_path):
    path = write(tmp_path, RATE + XYZ, ENTITIES)
    with pytest.raises(UserError, match=r"it has a document type .* take that line out"):
        SignalDecoder().decode(path)
    path.write_bytes(write(tmp_path, RATE + XYZ).read_bytes()[:1500])
    with pytest.raises(UserError, match=r"no element found|unclosed token"):
        SignalDecoder().decode(path)
