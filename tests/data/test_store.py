import os
import shutil
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Semaphore
from unittest.mock import Mock

import numpy as np
import pytest

from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import LazyRecordings, Store, Unusable, cache_root, list_files
from tex_lightning.errors import UserError

DECODERS = {"haptic": SignalDecoder(), "image": PhotoDecoder()}
BARE = ("bare.txt", "timed.csv")


@pytest.fixture
def store(tmp_path) -> Store:
    return Store(cache_root(str(tmp_path / "cache")), DECODERS)


def entries(store: Store) -> set[Path]:
    return {path for path in store.root.rglob("*") if path.is_file()}


def test_gives_what_decoding_gives_from_a_read_only_map(store, surfaces):
    trace, photo = (read_folder(surfaces).of(modality).rows[0] for modality in ("haptic", "image"))
    np.testing.assert_array_equal(store.load(trace), SignalDecoder().decode(trace.path)[0])
    np.testing.assert_array_equal(store.load(photo), PhotoDecoder().decode(photo.path)[0])
    assert isinstance(store.load(trace), np.memmap)
    with pytest.raises(ValueError, match="read-only"):
        store.load(trace)[0, 0] = 1


def test_decodes_each_file_once(store, surfaces, monkeypatch):
    rows = read_folder(surfaces)
    assert store.fill(rows) == []
    assert len(entries(store)) == len(rows)

    def forbidden(*args):
        raise AssertionError("decoded twice")

    monkeypatch.setattr(SignalDecoder, "decode", forbidden)
    monkeypatch.setattr(PhotoDecoder, "decode", forbidden)
    store.fill(rows)
    store.load(rows.of("haptic").rows[0])


def test_threads_parse_headers_of_arrays_one_at_a_time(store, tmp_path, monkeypatch):
    """Python 3.11 raises a SystemError where two do, which was taken for a damaged file."""
    rows, load, inside, most = [], np.load, Semaphore(0), []

    def watched(*args, **options):
        inside.release()
        time.sleep(0.01)
        most.append(inside._value)
        inside.acquire()
        return load(*args, **options)

    for number in range(8):
        np.save(tmp_path / f"{number}.npy", np.random.default_rng(number).standard_normal(1000))
        rows.append(Recording("x", "haptic", tmp_path / f"{number}.npy", number))
    monkeypatch.setattr(np, "load", watched)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(store.load, rows))
    assert len(most) >= len(rows)
    assert max(most) == 1


def test_what_is_derived_is_computed_once_of_each_file_and_key(store, surfaces):
    one, other = read_folder(surfaces).of("haptic").rows[:2]
    calls = []

    def derived(row, key):
        return store.derived(row, key, lambda: calls.append((row, key)) or np.arange(3.0))

    for row, key in [(one, "a"), (one, "a"), (other, "a"), (one, "b")]:
        np.testing.assert_array_equal(derived(row, key), np.arange(3.0))
    assert calls == [(one, "a"), (other, "a"), (one, "b")]


def test_a_changed_file_or_setting_is_decoded_anew(store, tmp_path):
    path = tmp_path / "data" / "a" / "haptic" / "1.npy"
    path.parent.mkdir(parents=True)
    np.save(path, np.ones(100))
    (row,) = read_folder(tmp_path / "data")
    assert store.load(row).max() == 1
    np.save(path, np.full(100, 2.0))
    os.utime(path, ns=(1, 1))
    assert store.load(row).max() == 2
    half_rate = Store(store.root.parent, {"haptic": SignalDecoder(sampling_rate=5000)})
    assert half_rate.load(row).shape == (1, 50)
    chosen = Store(store.root.parent, {"haptic": SignalDecoder(channels=(0,))})
    assert chosen._entry(row) != store._entry(row)


def test_a_store_keeps_to_the_files_that_it_was_filled_with(store, tmp_path):
    """As they were at the beginning of a task: looking at each again costs as much as reading."""
    path = tmp_path / "a.npy"
    np.save(path, np.ones(100))
    row = Recording("a", "haptic", path, 0)
    store.fill([row])
    path.unlink()
    assert store.load(row).max() == 1
    assert store.rate(row) == store.decoders["haptic"].file_rate


def test_a_damaged_entry_is_replaced(store, surfaces):
    row = read_folder(surfaces).of("haptic").rows[0]
    whole = np.array(store.load(row))
    (entry,) = entries(store)
    for damage in (b"", entry.read_bytes()[:50], entry.read_bytes()[:-8]):
        entry.write_bytes(damage)
        np.testing.assert_array_equal(store.load(row), whole)


@contextmanager
def another_user(folder: Path):
    """Become one who may read the folder and write nothing."""
    paths, user = [folder, *folder.rglob("*")], os.geteuid()
    for path in paths:
        path.chmod(0o555 if path.is_dir() else 0o444)
    os.seteuid(user or 65534)  # permissions do not bind root
    try:
        yield
    finally:
        os.seteuid(user)
        for path in paths:
            path.chmod(0o755)


def test_a_cache_of_another_user_can_be_read(store, surfaces):
    with tempfile.TemporaryDirectory() as name:  # those of pytest are for one user
        folder = Path(name)
        shutil.copytree(surfaces, folder / "data")
        shared, rows = folder / "cache", read_folder(folder / "data").rows
        kept, other = rows[:2], rows[2]
        assert Store(cache_root(str(shared)), DECODERS).fill(kept) == []
        whole = [np.array(SignalDecoder().decode(row.path)[0]) for row in kept]
        with another_user(folder):
            again = Store(cache_root(str(shared)), DECODERS)
            assert again.fill(kept) == []
            for row, expected in zip(kept, whole, strict=True):
                np.testing.assert_array_equal(again.load(row), expected)
            with pytest.raises(UserError, match=rf"{shared} cannot be written .*data\.cache_dir"):
                again.load(other)


def test_an_entry_knows_the_rate_of_its_file(store, surfaces, tmp_path):
    header = read_folder(surfaces).of("haptic").rows[0]
    np.savetxt(tmp_path / "bare.txt", np.ones(100))
    times = np.arange(100) / 2500 + np.tile([0, 2e-5], 50)
    np.savetxt(tmp_path / "timed.csv", np.stack([times, np.ones(100)]).T, header="time,x")
    bare, timed = (Recording("a", "haptic", tmp_path / name, 0) for name in BARE)
    stated = replace(bare, sampling_rate=5000.0)
    rows = [header, bare, stated, timed]
    assert store.fill(rows) == []
    for again in (store, Store(store.root.parent, DECODERS)):
        rates = [again.rate(row) for row in rows]
        assert rates[:3] == [10_000, 10_000, 5000]
        assert rates[3] == pytest.approx(2500, rel=1e-3)
    assert len(entries(store)) == 4  # another rate, another entry
    entry = store._entry(bare)
    entry.write_bytes(entry.read_bytes()[:-8])
    assert store.rate(bare) == 10_000


def test_a_missing_file_and_an_unwritable_cache_are_said(store, surfaces, tmp_path, monkeypatch):
    row = read_folder(surfaces).rows[0]
    gone = type(row)("a", "haptic", tmp_path / "gone.wav", 0)
    (missing,) = store.fill([gone])
    assert missing.recording == gone
    assert "gone.wav does not exist" in missing.reason
    (tmp_path / "file").write_text("x")
    with monkeypatch.context() as patched:
        patched.setattr("numpy.save", Mock(side_effect=OSError("9 requested and 3 written")))
        with pytest.raises(UserError, match=r"written \(9 requested and 3 written\); free"):
            store._write(tmp_path / "a.npy", store._decode(row))
    with pytest.raises(UserError, match=r"data\.cache_dir"):
        cache_root(str(tmp_path / "file"))


def test_who_has_no_home_folder_is_told_to_name_a_cache(monkeypatch):
    """As a user that a container was started as, whom its system does not know."""
    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", Mock(side_effect=KeyError))
    with pytest.raises(UserError, match=r"Cache folder ~ .*set data\.cache_dir"):
        cache_root(None)


def test_parts_of_a_file_make_the_whole_and_have_entries_of_their_own(store, surfaces):
    for modality in ("haptic", "image"):
        row = read_folder(surfaces).of(modality).rows[0]
        before = store._entry(row)
        parts = [replace(row, part=part) for part in ((0, 0.25), (0.25, 0.5), (0.5, 1))]
        pieces = [store.load(part) for part in parts]
        np.testing.assert_array_equal(np.concatenate(pieces, axis=1), store.load(row))
        assert store._entry(row) == before
        assert len({store._entry(part) for part in parts} | {before}) == 4
    trace = replace(read_folder(surfaces).of("haptic").rows[0], part=(0, 0.5))
    assert store.rate(trace) == 10_000
    with pytest.raises(UserError, match=r"Part 0-0.00001 of .* is empty, as the file has only"):
        store.load(replace(row, part=(0, 0.00001)))


def test_some_of_the_recordings_are_a_list_and_one_is_loaded_when_it_is_looked_at():
    load = Mock(side_effect=str.upper)
    recordings = LazyRecordings(["a", "b", "c"], load)
    assert (len(recordings), load.call_count) == (3, 0)
    assert (recordings[-1], load.call_count) == ("C", 1)
    assert (recordings[:2], recordings[1:9]) == (["A", "B"], ["B", "C"])
    assert recordings[::-1] == [*recordings][::-1]


def test_many_files_of_one_reason_are_a_line_with_the_first_five(tmp_path):
    rows = [Recording("a", "image", tmp_path / f"{n}.png", n) for n in range(250)]
    small = [Unusable(row, f"{row.source}: The photo is too small.") for row in rows]
    other = Unusable(rows[0], f"{rows[0].source}: It is no photo.")
    one, two = list_files([*small, other])
    assert one == (
        f"- {rows[0].source}: The photo is too small. The same of 249 others: 1.png, 2.png, "
        "3.png, 4.png, and 245 more."
    )
    assert two.endswith("It is no photo.")
    assert list_files(small[:1]) == [f"- {small[0].reason}"]
