"""The run folder: its owner, settings and overrides."""

import errno
import json
import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout
from omegaconf import OmegaConf

from tex_lightning.core.files import read_or_empty, read_record, unwritable, write_text
from tex_lightning.errors import UserError, listed
from tex_lightning_runtime.files import expanded, require_readable_name

log = logging.getLogger(__name__)

SETTINGS, RESULTS = "settings.json", "results.json"
SUFFIX = ".ckpt"  # of checkpoints of this package
FAILURE = "failure.json"  # in the folder of a job of a sweep that failed
LOCK = ".lock"  # held by the process that runs there; one that is killed lets go of it
NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
USUAL = ("outputs", "TASK", "MODEL-DATA", "TIME")  # folders that a run makes if it is given none
WORK = ("checkpoints", "folds", "systems", "predictions", RESULTS)

LONGEST = 60  # letters of a system in the name of a folder

# Settings that change neither weights nor figures; a run may be continued with others.
FREE_KEYS = (
    "crossval.", "frontier.only", "logger.", "data.cache_dir",
    "data.num_workers", "trainer.accelerator",
    "trainer.devices", "trainer.num_nodes", "trainer.strategy", "trainer.threads", "callbacks.",
    "trusted", "data.reader.cache_dir", "data.reader.page", "verbose",
)  # fmt: skip


def holds_work(directory: Path) -> bool:
    """Return whether a run has left something that a later one goes on from, or could spoil."""
    return any((directory / name).exists() for name in WORK)


@contextmanager
def locked_folder(
    directory: Path, key: str = "hydra.run.dir", *, patience: float = 0
) -> Iterator[None]:
    """Lock a run folder against other processes, where its file system has locks.

    Args:
        directory: The folder; made if it does not exist.
        key: Key of the configuration that names it.
        patience: Seconds to wait for another process.

    Raises:
        UserError: If another process runs in it, or it cannot be written to.
    """
    require_readable_name(directory)  # of TensorBoard's events
    lock = FileLock(directory / LOCK, timeout=patience)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        raise UserError(
            f"Another process runs in {directory}; wait for its end or choose another {key}."
        ) from error
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise unwritable(directory, error) from error
        log.warning(
            "Folder %s lies on a file system without locks (%s): start no other run in it before "
            "this one ends.", directory, error.strerror,
        )  # fmt: skip
    try:
        yield
    finally:
        lock.release()


def remove_if_empty(directory: Path) -> None:
    """Remove a run folder in its usual place, and those around it, as far as they hold nothing.

    The current folder stays, which a prediction has for its run folder.
    """
    here = Path.cwd()
    with suppress(OSError):
        for folder in (directory, *directory.parents[: len(USUAL) - 1]):
            if here.is_relative_to(folder.resolve()):
                break
            folder.rmdir()


def claim_folder(
    directory: Path, values: Mapping[str, Any], record: Mapping[str, Any], key: str
) -> None:
    """Write settings and overrides to the run folder, unless it holds another run.

    Hydra would write its own record before any check, so it is disabled
    and ``.hydra`` is written here.

    Args:
        directory: The run folder.
        values: All settings by their dotted keys.
        record: By name the content of each file of ``.hydra``.
        key: Key that names the folder, for messages.

    Raises:
        UserError: If another run lives there; nothing of it is changed.
    """
    note = directory / SETTINGS
    wanted = {name: value for name, value in values.items() if not name.startswith(FREE_KEYS)}
    if note.is_file() and holds_work(directory):
        before = read_record(note)
        names = (name for name in {*wanted, *before} if not _is_beside(name, wanted, before))
        differing = sorted(name for name in names if wanted.get(name) != before.get(name))
        if differing:
            differing = ["task"] if "task" in differing else differing  # which brings the others
            raise UserError(
                f"Run folder {directory} holds a run with another {listed(differing)}; "
                f"choose another {key}."
            )
        log.info("Going on with the run in %s.", directory)
    write_text(note, json.dumps(wanted, indent=1, sort_keys=True))
    for name, content in record.items():
        write_text(directory / ".hydra" / f"{name}.yaml", OmegaConf.to_yaml(content))


def _is_beside(key: str, settings: dict[str, Any], earlier: dict[str, Any]) -> bool:
    """Return whether a key is of a sense that no run uses, and a user's folder has or had."""
    section, _, rest = key.partition(".")
    name, used = rest.partition(".")[0], ("baseline", *(settings.get("model.senses") or ()))
    target = f"model.{name}._target_"
    known = (target in settings) == (target in earlier)
    return section == "model" and not known and name not in used


def system_name(source: str | Path) -> str:
    """Return the model whose checkpoint it is; of a network inside a fusion its own name."""
    try:
        file = find_checkpoint(source)
        results = read_results(run_of(file))
        whole = file.stem == [*results.get("networks", {"": None})][-1]
        name = str(results["model"]) if whole else file.stem
        return re.sub(r"[^\w.+-]+", "_", name)[:LONGEST] or "checkpoint"
    except (UserError, KeyError, OSError):  # the task says what is wrong with it
        return "checkpoint"


def run_of(checkpoint: Path) -> Path:
    """Return the run folder that a checkpoint is of; of a fold's that of the whole run."""
    run = checkpoint.absolute().parent.parent
    return run.parent.parent if run.parent.name == "folds" else run


def note_failure(directory: Path, overrides: Sequence[str], reason: str) -> None:
    """Log the reason of a failure, and write it into the folder of a job of a sweep."""
    log.error("%s", reason)
    text = json.dumps({"error": reason, "overrides": [*overrides]}, indent=1)
    write_text(directory / FAILURE, text)


def checkpoint_of(directory: Path, kind: str) -> Path:
    """Return the checkpoint of a network in a run folder."""
    return directory / "checkpoints" / f"{kind}{SUFFIX}"


def predictions_of(directory: Path, kind: str) -> Path:
    """Return the table of the test samples of a network in a run folder."""
    return directory / "predictions" / f"{kind}.csv"


def read_results(directory: Path) -> dict[str, Any]:
    """Return the results of a run or a fold; empty of one that did not finish."""
    return read_or_empty(directory / RESULTS)


def write_results(directory: Path, results: dict[str, Any]) -> None:
    """Write the results of a run or a fold, complete or not at all; equal ones keep their date."""
    target, text = directory / RESULTS, json.dumps(results, indent=2) + "\n"
    if not (target.is_file() and target.read_bytes() == text.encode()):
        write_text(target, text)


def find_checkpoint(source: str | Path) -> Path:
    """Return the checkpoint file that is meant: the file itself, or a run folder's own network.

    Raises:
        UserError: If the folder holds none, or several of which none is the model's.
    """
    path = expanded(source)
    if not path.is_dir():
        return path
    files = {file.stem: file for file in sorted(path.glob(f"checkpoints/*{SUFFIX}"))}
    if not files:
        folds = sorted(path.glob(f"folds/*/checkpoints/*{SUFFIX}"))
        example = f"the file of a fold, such as {folds[0]}" if folds else "that of a finished run"
        raise UserError(
            f"{path} holds no finished checkpoint (checkpoints/KIND.ckpt); give {example}."
        )
    settings = read_or_empty(path / SETTINGS)
    senses = settings.get("model.senses") or list(files)
    kind = senses[0] if len(senses) == 1 else "fusion"
    if settings.get("task") in ("enroll", "adapt"):  # which have the senses of another model
        kind = next(iter(files))
    if kind not in files:
        choices = " or ".join(map(str, files.values()))
        raise UserError(f"{path} holds no finished {kind}.ckpt; give {choices}.")
    return files[kind]
