"""Print what a network makes of recordings, one line of JSON for each sample."""

import json
import re
import sys
from argparse import ArgumentParser
from glob import glob, has_magic
from io import TextIOWrapper
from pathlib import Path

from tex_lightning_runtime.errors import UserError, require
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.photos import IMAGE_SUFFIXES
from tex_lightning_runtime.runtime import Runtime
from tex_lightning_runtime.traces import TRACE_SUFFIXES, stands_for_all


def main() -> int:
    """Run ``tex-runtime``; the exit status is 2 if anything could not be classified."""
    parser, failures = ArgumentParser(prog="tex-runtime", description=__doc__), []
    parser.add_argument("model", help="file of task=export export.format=onnx")
    parser.add_argument("inputs", nargs="*", metavar="NAME=FILE", help="or a folder or pattern")
    parser.add_argument("--info", action="store_true", help="print what the file says of itself")
    parser.add_argument("--rate", type=float, help="in Hz, of files that carry none")
    parser.add_argument("--top-k", type=int, default=3, help="how many classes to list")
    asked = parser.parse_args()
    try:
        runtime = Runtime(asked.model, top_k=asked.top_k)
        samples = [] if asked.info else _samples(runtime, asked.inputs)
    except UserError as error:
        parser.exit(2, f"{_safe(f'Error: {error}')}\n")
    if asked.info:
        _print(runtime.card, indent=1)
    for files in samples:
        try:
            _print({**files, **runtime.predict(rate=asked.rate, **files)})
        except Exception as error:  # which does not stop the others
            kind = "" if isinstance(error, UserError) else f"{type(error).__name__}: "
            said = " ".join(f"{kind}{error}".split())
            failures.append(_safe(f"Error: {' and '.join(files.values())}: {said}"))
            print(failures[-1], file=sys.stderr)
    return 2 if failures else 0


def _print(value: object, indent: int | None = None) -> None:
    """Print JSON in UTF-8 without what steers a terminal."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(encoding="utf-8")
    text = json.dumps(value, indent=indent, ensure_ascii=False)
    print("\n".join(map(_safe, text.split("\n"))), flush=True)


def _safe(text: str) -> str:
    """Escape control characters and marks of writing direction as JSON does."""
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)


def _samples(runtime: Runtime, inputs: list[str]) -> list[dict[str, str]]:
    """Files by modality of every sample that the words of the command line name."""
    words = dict(word.partition("=")[::2] for word in inputs)
    require(words and all(words.values()), "Give recordings as NAME=FILE, such as haptic=A.wav.")
    require(len(words) == len(inputs), "Give each modality once, several files as a folder.")
    files = {name: _files(value) for name, value in words.items() if runtime.sense(name)}
    said = " and ".join(f"{len(each)} of {name}" for name, each in files.items())
    require(len({*map(len, files.values())}) == 1, f"There are {said}; give as many of each.")
    require(all(files.values()), f"{' '.join(inputs)} gives no file of a known type.")
    return [dict(zip(files, sample, strict=True)) for sample in zip(*files.values(), strict=True)]


def _files(value: str) -> list[str]:
    """A file, or what lies in a folder or matches a pattern, ordered by name with 2 before 10."""
    path = expanded(value)
    if path.is_file() or not (path.is_dir() or has_magic(value)):
        return [value]
    found = glob(f"{path}/*" if path.is_dir() else str(path), recursive=True)  # noqa: PTH207
    known = [each for each in found if each.lower().endswith((*TRACE_SUFFIXES, *IMAGE_SUFFIXES))]
    known = [each for each in known if stands_for_all(Path(each))]  # of files of an axis each
    return sorted(known, key=lambda each: re.sub(r"\d+", lambda n: n[0].zfill(20), Path(each).stem))


if __name__ == "__main__":
    sys.exit(main())
