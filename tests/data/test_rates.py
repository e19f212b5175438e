"""Who decides on the rate of a trace, in which order, and what contradicts what."""

import json
from dataclasses import replace

import numpy as np
import pytest
import soundfile

from tex_lightning.config import DataConfig
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.rates import stated_rate
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import write_manifest
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError

SETTINGS = SignalDecoder()
SAMPLES = np.random.default_rng(0).uniform(-1, 1, 400).round(6)


@pytest.fixture
def root(tmp_path):
    """Two classes with a bare trace each, and one with its own column of time."""
    for label in ("a", "b"):
        (tmp_path / "data" / label / "haptic").mkdir(parents=True)
        np.save(tmp_path / "data" / label / "haptic" / "1.npy", SAMPLES)
    times = np.arange(400) / 2500
    text = "\n".join(f"{time:.6f},{value}" for time, value in zip(times, SAMPLES, strict=True))
    (tmp_path / "data" / "b" / "haptic" / "2.csv").write_text(text)
    return tmp_path / "data"


READERS = "tex_lightning.data.readers"


def read(root):
    folder = {"_target_": f"{READERS}.folder.FolderReader", "root": str(root)}
    return read_recordings(DataConfig(reader=folder, folds=10))


def rates(root):
    return {f"{row.label}/{row.path.name}": row.sampling_rate for row in read(root)}


def test_a_table_in_the_root_or_a_class_gives_rates(root):
    assert set(rates(root).values()) == {None}
    (root / "rates.csv").write_text("path,rate\na/haptic/1.npy,2500\nb/haptic/1.npy,5000\n")
    assert rates(root) == {"a/1.npy": 2500, "b/1.npy": 5000, "b/2.csv": None}
    (root / "b" / "rates.csv").write_text("path,rate\nhaptic/1.npy,5000\n")
    (root / "rates.csv").write_text("\ufeffpath;rate\r\na/haptic/1.npy;2500,5\r\n")
    assert rates(root) == {"a/1.npy": 2500.5, "b/1.npy": 5000, "b/2.csv": None}


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("file,rate\na/haptic/1.npy,1\n", "lacks the column path; its first line must name"),
        ("path,rate\na/haptic/1.npy,fast\n", "line 2: rate is 'fast', no positive number"),
        ("path,rate\na/haptic/1.npy\n", "line 2: rate is None, no positive number"),
        ("path,rate\na/haptic/1.npy,-1\n", "no positive number"),
        ("path,rate\na/haptic/1.npy,inf\n", "no positive number"),
        ("path,rate\na/haptic/1.npy,5\na/haptic/1.npy,5\n", "line 3: 1.npy is listed twice"),
        ("path,rate\n\na/haptic/2.npy,5\n", "line 3: file .*2.npy does not exist"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(root, table, message):
    (root / "rates.csv").write_text(table)
    with pytest.raises(UserError, match=message):
        rates(root)


@pytest.mark.parametrize("name", ["1.npy.json", "1.json"])
def test_a_sidecar_is_found_by_readers_and_for_a_single_file(root, name):
    path = root / "a" / "haptic" / "1.npy"
    path.with_name(name).write_text(json.dumps({"rate": 2500, "operator": "x"}))
    assert rates(root)["a/1.npy"] == 2500
    trace, source = SETTINGS.decode(path)
    assert (trace.shape, source.source, source.hz) == ((1, 1600), "stated", 2500)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is no JSON"),
        ('{"rate": "2500"}', "rate='2500', which is no positive number"),
        ('{"rate": true}', "no positive number"),
        ('{"rate": 0}', "no positive number"),
        ('{"sample_rate": 2500}', "has the key sample_rate; rename it to rate"),
        ('{"Fs": 2500}', "has the key Fs"),
    ],
)
def test_what_is_wrong_with_a_sidecar_is_said(root, content, message):
    path = root / "a" / "haptic" / "1.npy"
    path.with_name("1.npy.json").write_text(content)
    for use in (lambda: rates(root), lambda: SETTINGS.decode(path)):
        with pytest.raises(UserError, match=message):
            use()


def test_json_of_other_programs_beside_a_trace_says_nothing(root):
    path = root / "a" / "haptic" / "1.npy"
    for content in ('[{"rate": 5}]', '{"operator": "x"}'):
        path.with_suffix(".json").write_text(content)
        assert rates(root)["a/1.npy"] is None


def test_the_file_goes_before_what_is_said_of_it_and_that_before_the_assumption(root, tmp_path):
    bare, timed = root / "b" / "haptic" / "1.npy", root / "b" / "haptic" / "2.csv"
    wav = tmp_path / "1.wav"
    soundfile.write(wav, SAMPLES, 4000, subtype="FLOAT")
    found = [
        SignalDecoder(file_rate=8000).decode(path, given)[1]
        for path, given in ((wav, 4000), (timed, 2510), (bare, 2500), (bare, None))
    ]
    assert [(rate.source, round(rate.hz)) for rate in found] == [
        ("header", 4000),
        ("time column", 2500),
        ("stated", 2500),
        ("assumed", 8000),
    ]


def test_contradictions_are_refused(root, tmp_path):
    timed, bare = root / "b" / "haptic" / "2.csv", root / "b" / "haptic" / "1.npy"
    with pytest.raises(UserError, match="2,500 Hz by its time column, but 10,000 Hz are stated"):
        SETTINGS.decode(timed, 10_000)
    wav = tmp_path / "1.wav"
    soundfile.write(wav, SAMPLES, 4000)
    with pytest.raises(UserError, match="4,000 Hz by its header, but 10,000 Hz are stated"):
        SETTINGS.decode(wav, 10_000)
    bare.with_name("1.json").write_text('{"rate": 2500}')
    (root / "rates.csv").write_text("path,rate\nb/haptic/1.npy,10000\n")
    with pytest.raises(UserError, match=r"1\.json gives 1\.npy 2,500 Hz, but .*rates\.csv 10,000"):
        rates(root)
    (root / "rates.csv").unlink()
    with pytest.raises(UserError, match=r"manifest or reader gives 1\.npy 10,000 Hz, but"):
        SETTINGS.decode(bare, 10_000)


def test_another_rate_is_decoded_anew(root, tmp_path):
    store = Store(tmp_path / "cache", {"haptic": SETTINGS})
    lengths = []
    for rate in (2500, 5000):
        (root / "rates.csv").write_text(f"path,rate\na/haptic/1.npy,{rate}\n")
        row = next(row for row in read(root) if row.sampling_rate)
        lengths.append(store.load(row).shape[1])
    assert lengths == [1600, 800]


def test_a_manifest_keeps_the_rates_of_a_folder(root, tmp_path):
    (root / "rates.csv").write_text("path,rate\na/haptic/1.npy,2500\n")
    write_manifest(read(root), tmp_path / "m.csv")
    again = read_recordings(
        DataConfig(
            reader={
                "_target_": f"{READERS}.folder.ManifestReader",
                "manifest": str(tmp_path / "m.csv"),
            },
            folds=10,
        )
    )
    assert set(again) == {replace(row, path=row.path.resolve()) for row in read(root)}
    assert sorted(row.sampling_rate or 0 for row in again) == [0, 0, 2500]


def test_whoever_tells_the_rate_the_decoded_trace_is_that_of_the_wav(tmp_path):
    rate = 2200
    soundfile.write(tmp_path / "a.wav", SAMPLES, rate, subtype="DOUBLE")
    times = np.arange(400) / rate * 1e6
    np.savetxt(tmp_path / "b.csv", np.stack([times, SAMPLES]).T, header="time_us x", fmt="%.9g")
    np.save(tmp_path / "c.npy", SAMPLES)
    (tmp_path / "c.json").write_text(json.dumps({"rate": rate}))
    np.savetxt(tmp_path / "d.txt", SAMPLES)
    (tmp_path / "rates.csv").write_text(f"path,rate\nd.txt,{rate}\n")
    expected = SETTINGS.decode(tmp_path / "a.wav")[0]
    assert expected.shape == (1, 1819)  # 400 samples / 2200 Hz * 10 kHz, rounded up
    for name in ("b.csv", "c.npy", "d.txt"):
        trace = SETTINGS.decode(tmp_path / name)[0]
        np.testing.assert_allclose(trace, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.json", "[" * 50_000, "is no JSON .*recursion"),
        ("a.json", '{"rate": 1' + "0" * 400 + "}", "is no positive number; give Hz"),
        ("rates.csv", "path,rate\na\0b,1\n", r"file .*a.x00b does not exist"),
        ("rates.csv", "path,rate\n" + "x" * 5000 + ",1\n", "more characters.* does not exist"),
        ("rates.csv", "path,rate," + "x" * (3 << 20), "a line of more than 1 MiB"),
    ],
)
def test_a_statement_that_is_damaged_is_told_in_a_sentence(tmp_path, name, content, message):
    np.save(tmp_path / "a.npy", np.zeros(20))
    (tmp_path / name).write_text(content)
    with pytest.raises(UserError, match=message) as caught:
        stated_rate(tmp_path / "a.npy")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 700
