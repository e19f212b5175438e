"""Digests of weights, votes and labels at fixed seeds, to see what a change of code changed.

``python -m benchmarks digests --out=FILE``, and after the change ``--against=FILE``

Tiny budgets and one thread, through the command line. Tensors of a checkpoint count by their
content, whatever they are called. ``--data=DIR`` (or ``TEX_LIGHTNING_REAL_DATA``) is a folder of
real recordings with ``lmt16`` and ``surfaces10.csv``; without it their cases are left out.
"""

import csv
import hashlib
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import torch

from benchmarks._commands import output, run
from tex_lightning.core.files import write_text

SURFACES = ("data=folder", "data.root={surfaces}")
TINY = ("debug=tiny", "trainer.threads=1", "logger.tensorboard=null")
LMT16 = ("data=folder", "data.root={real}/lmt16", "data.classes=4")
PAIRED = ("data=manifest", "data.manifest={real}/surfaces10.csv", "data.classes=3",
          "data.half_scale=false")  # fmt: skip
CASES = {
    "fusion_fc2": ("model=fusion", *SURFACES, *TINY),
    "fusion_alexnet": ("model=fusion", "weights=null", *SURFACES, *TINY),  # nothing published
    "fusion_fc3": ("model=fusion_fc3", *SURFACES, *TINY),
    "haptic_lmt16": ("model=haptic", "data.test_fold=0", *LMT16, *TINY),
    "visual_lite0": ("model=visual_efficientnet", "weights=imagenet", *SURFACES, *TINY),
    "few_fusion": ("experiment=few/fusion", *SURFACES, *TINY),
    "few_fusion_real": ("experiment=few/fusion", *PAIRED, *TINY),
    "minirocket": ("model=minirocket", *SURFACES, *TINY),
    "paper_fusion_fc2_tcnn": ("experiment=paper/fusion_fc2_tcnn", *SURFACES, *TINY),
    "known": ("experiment=few/haptic", "data.hold_out=[{last}]", *SURFACES, *TINY),
    "evaluate": ("task=evaluate", "checkpoint={runs}/fusion_fc2", *SURFACES, *TINY),
    "stability": ("task=stability", "stability.systems=[{runs}/fusion_fc2]",
                  "stability.only=[white_noise,clipping,jpeg]", *SURFACES, *TINY),
    "enroll": ("task=enroll", "checkpoint={runs}/known", "data.test_fold=0", *SURFACES, *TINY),
    "export": ("task=export", "checkpoint={runs}/few_fusion", "export.check=2",
               "export.out={runs}/export", *SURFACES, *TINY),
    "stream": ("task=stream", "checkpoint={runs}/fusion_fc2/checkpoints/haptic.ckpt",
               "haptic={trace}", "stream.chunk=0.5"),
    "predict": ("task=predict", "checkpoint={runs}/fusion_fc2", "haptic={trace}",
                "image={photo}"),
}  # fmt: skip
VOTES = ("label", "predicted", "share", "votes", "probabilities")
SPOKEN = ("time", "label", "fragments", "confidence", "probability", "top_k")
TRIALS = ("perturbation", "severity", "test_samples", "vote_accuracy", "flip_rate")


def measure(out: str = "", against: str = "", data: str = "") -> dict[str, Any]:
    """Digests by case; which differ from those of a file."""
    data = data or os.environ.get("TEX_LIGHTNING_REAL_DATA", "")
    with tempfile.TemporaryDirectory() as name:
        found = _digests(Path(name), data)
    if out:
        write_text(Path(out), json.dumps(found, indent=1, sort_keys=True) + "\n")
    if not against:
        return found
    expected = json.loads(Path(against).read_text(encoding="utf-8"))
    differing = sorted(key for key in found if found[key] != expected.get(key))
    return {
        "compared": len({*found} & {*expected}),
        "differ": ", ".join(differing) or "none",
        "not compared": ", ".join(sorted({*expected} - {*found})) or "none",
    }


def _digests(folder: Path, data: str) -> dict[str, str]:
    surfaces, runs = folder / "surfaces", folder / "runs"
    drawn = ("task=generate", "data.classes=3", f"generate.out={surfaces}", "debug=tiny")
    run(folder, "generate", (*drawn, "data.synthetic.recordings=10"))
    *_, last = sorted(path.name for path in surfaces.iterdir() if path.is_dir())
    names = {
        "surfaces": surfaces, "runs": runs, "real": data, "last": last,
        "trace": min((surfaces / last).glob("haptic/*")),
        "photo": min((surfaces / last).glob("image/*")),
    }  # fmt: skip
    found = {}
    for case, arguments in CASES.items():
        if not data and any("{real}" in argument for argument in arguments):
            continue
        printed = run(folder, case, [argument.format(**names) for argument in arguments])
        found |= {f"{case}/{key}": digest for key, digest in digests_of(runs / case).items()}
        if case in ("stream", "predict"):
            found[f"{case}/printed"] = _of_lines(printed)
    for number, trace in enumerate(sorted(surfaces.glob("*/haptic/*"))[::11]):
        photo = min((trace.parents[1] / "image").iterdir())
        given = (str(runs / "export" / "fusion.onnx"), f"haptic={trace}", f"image={photo}")
        printed = output([sys.executable, "-m", "tex_lightning_runtime", *given], folder)
        found[f"export/label {number}"] = json.loads(printed.splitlines()[-1])["label"]
    return found


def digests_of(run: Path) -> dict[str, str]:
    """Digests of weights by network, of votes by network, and of the trials of stability."""
    found = {f"weights {path.stem}": _of_weights(path) for path in run.glob("checkpoints/*.ckpt")}
    for path in run.glob("predictions/*.csv"):
        found[f"votes {path.stem}"] = _of_table(path, VOTES)
    if (path := run / "stability.csv").is_file():
        found["trials"] = _of_table(path, TRIALS)
    return {key: found[key] for key in sorted(found)}


def _of_weights(path: Path) -> str:
    content = torch.load(path, map_location="cpu", weights_only=True)
    state = content.get("state_dict", {})  # a baseline's estimator has none
    tensors = [value for name, value in state.items() if "statistics." not in name]
    return _digest(sorted([str(each.dtype), [*each.shape], _sha(each)] for each in tensors))


def _sha(tensor: torch.Tensor) -> str:
    return hashlib.sha256(tensor.contiguous().numpy().tobytes()).hexdigest()


def _of_table(path: Path, columns: tuple[str, ...]) -> str:
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return _digest(sorted([row.get(column, "") for column in columns] for row in rows))


def _of_lines(printed: str) -> str:
    lines = [json.loads(line) for line in printed.splitlines()]
    return _digest([[line.get(key) for key in SPOKEN] for line in lines])


def _digest(value: Any) -> str:  # noqa: ANN401
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()[:16]
