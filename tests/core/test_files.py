"""Files that are whole or not there: full disks and exceptions."""

import logging
import os
import resource
import signal
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch

from tex_lightning.core.console import LogFile
from tex_lightning.core.files import partial_path, read_record, write_atomically, write_text
from tex_lightning.data.store import fingerprint
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import read_outcomes
from tex_lightning.perturbations.table import read_severities


@contextmanager
def full_disk(limit: int):
    """Every file ends after so many bytes, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handler)


WRITERS = {
    "text": lambda path: write_text(path, "x" * 10_000),
    "checkpoint": lambda path: write_atomically(
        path, lambda partial: torch.save(torch.zeros(10_000), partial)
    ),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_full_disk_is_one_sentence_and_leaves_what_was_there(tmp_path, writer):
    target = tmp_path / "file"
    target.write_text("before")
    with full_disk(1000), pytest.raises(UserError, match=r"Cannot write .*file .*free some space"):
        WRITERS[writer](target)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert target.read_text() == "before"
    WRITERS[writer](target)
    assert target.stat().st_size > 1000


def test_other_errors_pass_and_leave_nothing(tmp_path):
    def fail(path: Path) -> None:
        path.write_text("half")
        raise RuntimeError("a fault of the program")

    with pytest.raises(RuntimeError, match="fault of the program"):
        write_atomically(tmp_path / "file", fail)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("folder", [False, True])
def test_two_processes_fill_paths_of_their_own_that_go(tmp_path, folder):
    target = tmp_path / "file"
    with partial_path(target, folder=folder) as one, partial_path(target, folder=folder) as other:
        assert one != other
        for path in (one, other):
            assert path.name.startswith(".file.")
            (path / "a" if folder else path).write_text("half")
    assert not list(tmp_path.iterdir())


def test_a_log_on_a_full_disk_ends_without_a_word(tmp_path, capsys):
    handler = LogFile(tmp_path / "log")
    with full_disk(100):
        for message in ("a" * 90, "b" * 90):
            handler.emit(logging.makeLogRecord({"msg": message}))
    assert (tmp_path / "log").read_text().startswith("a" * 90)
    assert capsys.readouterr().err == ""
    handler.emit(logging.makeLogRecord({"msg": "%d", "args": ("a fault of the program",)}))
    assert "Logging error" in capsys.readouterr().err
    handler.close()


def test_what_is_no_file_is_not_replaced_by_one(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for target in tmp_path.iterdir():
        before = target.stat()
        with pytest.raises(UserError, match="is a folder, a device or a pipe; give the path of a"):
            write_text(target, "new")
        assert target.stat() == before
    (tmp_path / "link").symlink_to("nowhere")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").read_text() == "new"


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("results.json", read_record),
        ("haptic.csv", read_outcomes),
        ("a.wav", fingerprint),
        ("a.yaml", read_severities),
    ],
)
def test_a_pipe_in_place_of_a_file_is_not_waited_for(tmp_path, name, read):
    os.mkfifo(tmp_path / name)
    with pytest.raises(UserError, match=r"is no file|a pipe or"):
        read(tmp_path / name)


@pytest.mark.parametrize("content", ['{"networks": ', "[1, 2]", "\0", "\u00e9"])
def test_a_damaged_record_is_one_sentence(tmp_path, content):
    path = tmp_path / "results.json"
    path.write_text(content, encoding="latin-1")
    with pytest.raises(
        UserError, match=rf"^Record {path} is [^\n]*; delete it and run its command again\.$"
    ):
        read_record(path)


def test_a_name_in_bytes_that_are_no_text_is_refused_and_can_be_reported(tmp_path):
    """As files have from an archive of a system with another encoding."""
    path = tmp_path / os.fsdecode(b"stra\xdfe.wav")
    path.touch()
    with pytest.raises(UserError, match=r"stra\\udcdfe.wav is no text in UTF-8; rename"):
        fingerprint(path)
    write_text(tmp_path / "report", str(path))
    assert (tmp_path / "report").read_text().endswith(r"stra\udcdfe.wav")


def test_a_log_whose_folder_is_gone_ends_no_program(tmp_path):
    log, file = logging.Logger("of a run that did not begin"), tmp_path / "gone" / "log"
    log.addHandler(handler := LogFile(file, delay=True))
    log.warning("later, of another library")
    file.parent.mkdir()
    log.warning("in its folder")
    handler.close()
    assert file.read_text() == "in its folder\n"
