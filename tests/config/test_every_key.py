"""Whatever a key is given, it is taken or refused in one sentence."""

import copy
import json
import math
import random
import signal
from itertools import islice

import numpy as np
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from tex_lightning.cli import to_user_error
from tex_lightning.config import CONF, READS, flatten
from tex_lightning.config.check import check_config, check_known, check_missing
from tex_lightning.config.composition import compose_config, keys_read
from tex_lightning.config.mistakes import MISTAKES
from tex_lightning.config.weights import read_config
from tex_lightning.errors import UserError

VALUES = ["abc", -1, 0, math.nan, math.inf, 1e300, 10**30, "", [], {}, [1], ["a"], {"a": 1}]
VALUES += [None, True, [[1]], "a\nb", "\x00", "x" * 10_000, "/", "/dev/null", "???", -0.5, [None]]
LONG = 900  # characters; the longest lists all perturbations
RUNS = 8  # accepted values of each task that are run
SECONDS = 240
FIT = ["model=fusion"]
INPUTS = ["haptic", "image", "sound", "checkpoint"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "given",
    [
        FIT,
        ["task=crossval", "model=fusion"],
        ["task=frontier"],
        ["task=predict", "checkpoint=RUN", "haptic=A.wav"],
        ["task=stream", "checkpoint=RUN", "haptic=A.wav"],
        ["task=evaluate", "checkpoint=RUN"],
        ["task=enroll", "checkpoint=RUN"],
        ["task=export", "checkpoint=RUN"],
        ["task=profile", "model=fusion"],
        ["task=record", "record.out=OUT", "record.label=oak", "haptic=A.wav"],
        ["task=generate"],
        ["task=stability", "stability.systems=[RUN]"],
    ],
    ids=lambda given: given[0],
)
def test_every_key_takes_or_refuses_every_value(given):
    composed = compose_config(CONF, given)
    keys = sorted(flatten(OmegaConf.to_container(composed, resolve=False)))
    if given != FIT:  # which has all keys, as those that many tasks read
        keys = sorted({*keys_read(composed), *INPUTS} - {*keys_read(compose_config(CONF, FIT))})
    accepted, said = [], {}
    for key in keys:
        for value in VALUES:
            try:
                check(composed, key, value)
                accepted.append((key, value))
            except UserError as error:
                said[key, repr(value)[:50]] = str(error)
            except MISTAKES:  # which the command line puts into words
                said[key, repr(value)[:50]] = ""
    assert not {case: text for case, text in said.items() if "\n" in text or len(text) > LONG}
    assert len(said) > len(accepted) > 0


def check(composed, key, value):
    """What the command line checks before any work."""
    changed = copy.deepcopy(composed)
    OmegaConf.update(changed, key, value)
    check_known(changed)
    check_missing(changed)
    check_config(read_config(changed))


@pytest.fixture
def commands(untrained, bands, surfaces, tmp_path):
    """A quick command for each task."""
    wav, photo = (
        surfaces / "alpha" / sense / f"alpha_0.{suffix}"
        for sense, suffix in (("haptic", "wav"), ("image", "png"))
    )
    folder = [f"data.root={surfaces}"]
    data = ["data=folder", *folder]
    few = ["experiment=few/haptic", *data]
    own = f"checkpoint={untrained}"
    sensor = tmp_path / "sensor.bin"
    np.zeros((3, 4000), "<f4").tofile(sensor)
    return {
        "fit": few,
        "crossval": ["task=crossval", "crossval.only=[0]", *few],
        "frontier": ["task=frontier", *data, "frontier.only=[mfcc_nb]", "crossval.only=[0]"],
        "predict": ["task=predict", own, f"haptic={wav}", f"image={photo}"],
        "stream": ["task=stream", own, f"haptic={wav}", f"image={photo}", "stream.chunk=0.5"],
        "evaluate": ["task=evaluate", f"checkpoint={bands}", *data],
        "enroll": ["task=enroll", f"checkpoint={bands}", *data],
        "export": ["task=export", own, "export.format=card"],
        "profile": ["task=profile", "model=haptic", "debug=tiny"],
        "record": ["task=record", "record.label=oak", f"record.out={tmp_path}/DATA",
                   f"haptic={sensor}", "record.least_seconds=0.1"],
        "generate": ["task=generate", f"generate.out={tmp_path}/GEN", "debug=tiny"],
        "stability": ["task=stability", f"stability.systems=[{bands}]", *data, "debug=tiny",
                      "stability.only=[quieter]"],
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("task", READS)
def test_what_is_accepted_runs_or_is_refused(task, commands, cli, tmp_path):
    given = commands[task]
    composed = compose_config(CONF, given)
    pairs = [(key, value) for key in [*keys_read(composed), *INPUTS] for value in VALUES]
    random.Random(task).shuffle(pairs)
    accepted = filter(parses, map(written, accepted_of(composed, pairs)))
    wrong = {}
    for number, case in enumerate(islice(accepted, RUNS)):
        with in_time():
            outcome = cli(*given, case, f"hydra.run.dir={tmp_path / str(number)}")
        lines = outcome.err.splitlines()
        good = outcome.status == 0 or (outcome.status == 2 and lines[-1].endswith("."))
        if not good or "Traceback" in outcome.err:
            wrong[case] = (outcome.status, outcome.err[-2000:])
    assert wrong == {}


def accepted_of(composed, pairs):
    """Keys and values that pass the checks."""
    for key, value in pairs:
        try:
            check(composed, key, value)
        except (UserError, *MISTAKES):
            continue
        yield key, value


def written(case):
    key, value = case
    return f"{key}={json.dumps(value)}"


def parses(text):
    """Whether Hydra reads it, as it does no line breaks."""
    try:
        return bool(OverridesParser.create().parse_override(text))
    except Exception as error:
        return to_user_error(error, began=False) is None


class in_time:
    """A block that must not hang."""

    def __enter__(self):
        signal.signal(signal.SIGALRM, self.stop)
        signal.alarm(SECONDS)

    def stop(self, *_):
        raise TimeoutError(f"more than {SECONDS} s")

    def __exit__(self, *_):
        signal.alarm(0)
