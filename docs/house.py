"""The packages and the imports between them, made from the code: ``python docs/house.py``."""

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path

from tex_lightning.report.table import markdown

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "tex_lightning"
HEADINGS = ("package", "purpose", "imports")
PURPOSES = {
    "estimator": "Trains and classifies arrays as scikit-learn would have it. Calls what the "
    "tasks call.",
    "cli": "Parses a command line or the arguments of `tl.train`. Composes the configuration and "
    "dispatches the task.",
    "tasks": "Contains one module for each `task=NAME`. Each has a function `run(config, job)`.",
    "recording": "Reads sensors, sound cards and cameras. Writes complete recordings into the "
    "folder of a class.",
    "studies": "Trains, tests and compares systems on folds. Contains cross-validation, frontier, "
    "stability and timing.",
    "learning": "Contains the LightningModule, callbacks and optimisers. Fits closed-form models "
    "and enrols classes.",
    "report": "Renders the context of a run as HTML, Markdown, terminal output and figures. Holds "
    "the published figures of the paper.",
    "export": "Traces a classifier to ONNX and checks the file. Writes the web page and model "
    "cards.",
    "evaluation": "Holds the table of test results. Computes accuracy, intervals, calibration and "
    "comparisons from it.",
    "inference": "Runs a trained network with fused and tiled operations. Contains the predictor, "
    "live streams and early stopping.",
    "testing": "Checks a part of a user's own by the code that tries it before a training.",
    "baselines": "Contains the other systems of the paper and MiniRocket. All share one interface "
    "to fit and to classify.",
    "classifier": "Combines senses and fusion layer with a decision rule. Rebuilds them from a "
    "card of plain values.",
    "senses": "Decodes the files of one modality and computes its features. Joins them with a "
    "network.",
    "data": "Reads tables of recordings and stores decoded arrays. Divides them into folds and "
    "batches.",
    "synthetic": "Renders photos, traces and sounds of random surfaces. Serves tests and first "
    "runs without a download.",
    "config": "Defines the typed schema with meanings and ranges. Composes, checks and explains a "
    "configuration.",
    "perturbations": "Contains functions that perturb a decoded recording. Defines their "
    "severities with units.",
    "networks": "Contains HapticNet, VisualNet, FusionNet and backbones as plain PyTorch modules. "
    "Derives their geometry and reads published weights.",
    "core": "Manages the run folder, atomic files, devices and the console. Knows nothing of "
    "recordings.",
    "errors": "Defines `UserError`. Formats names and values in messages.",
    "text": "Escapes text from files. Every name passes through it before it is shown.",
}


def layers() -> list[str]:
    """Return the packages from top to bottom, as ``lint-imports`` checks them."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    lines = settings["tool"]["importlinter"]["contracts"][0]["layers"]
    return [name.strip() for line in lines for name in line.split(":")]


def imports(package: str) -> set[str]:
    """Return the packages that the modules of ``package`` import."""
    folder = PACKAGE / package
    files = folder.rglob("*.py") if folder.is_dir() else [folder.with_suffix(".py")]
    names = {name for file in files for name in _modules(ast.parse(file.read_text("utf-8")))}
    parts = [name.split(".") for name in names if name.startswith("tex_lightning.")]
    return {part[1] for part in parts} - {package}


def _modules(tree: ast.AST) -> Iterator[str]:
    """Yield what a module imports from, except for type checkers alone."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        yield from _modules(node)


def house() -> str:
    """Return the table of packages in Markdown."""
    names = layers()
    rows = []
    for name in names:
        below = [f"`{other}`" for other in names if other in imports(name)]
        rows.append([f"`{name}`", PURPOSES[name], ", ".join(below)])
    return "\n".join(markdown(HEADINGS, rows))


if __name__ == "__main__":
    print(house())
