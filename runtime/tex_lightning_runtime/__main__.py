"""Print what a network makes of recordings, one line of JSON for each sample."""

import argparse
import json
import re
import sys
from glob import glob, has_magic
from pathlib import Path
from typing import Any

from tex_lightning_runtime.errors import UserError, require
from tex_lightning_runtime.files import PHOTOS, TRACES
from tex_lightning_runtime.runtime import Runtime


def main() -> int:
    """Run ``tex-runtime``; the exit status is 2 if anything could not be classified."""
    parser = argparse.ArgumentParser(prog="tex-runtime", description=__doc__)
    parser.add_argument("model", help="file of task=export export.format=onnx")
    said = "haptic=FILE, image=FILE; folders and patterns are matched in order"
    parser.add_argument("inputs", nargs="*", metavar="NAME=FILE", help=said)
    parser.add_argument("--info", action="store_true", help="print what the file says of itself")
    parser.add_argument("--rate", type=float, help="in Hz, of files that carry none")
    parser.add_argument("--top-k", type=int, default=3, help="how many classes to list")
    asked, failures = parser.parse_args(), 0
    try:
        runtime = Runtime(asked.model, top_k=asked.top_k)
        if asked.info:
            print(json.dumps(runtime.card, indent=1))
        for files in [] if asked.info else _samples(runtime, asked.inputs):
            try:
                print(
                    json.dumps({**files, **runtime.predict(rate=asked.rate, **files)}), flush=True
                )
            except UserError as error:  # which does not stop the others
                failures += 1
                print(f"Error: {' and '.join(files.values())}: {error}", file=sys.stderr)
    except UserError as error:
        failures += 1
        print(f"Error: {error}", file=sys.stderr)
    return 2 if failures else 0


def _samples(runtime: Runtime, inputs: list[str]) -> list[dict[str, Any]]:
    """Files by modality of every sample that the words of the command line name."""
    words = dict(word.partition("=")[::2] for word in inputs)
    require(words and all(words.values()), "Give recordings as NAME=FILE, such as haptic=A.wav.")
    files = {runtime.sense(name)["modality"]: _files(value) for name, value in words.items()}
    counts = {name: len(each) for name, each in files.items()}
    said = " and ".join(f"{count} of {name}" for name, count in counts.items())
    require(len(set(counts.values())) == 1, f"There are {said}; give as many of each.")
    require(all(counts.values()), f"{' '.join(inputs)} gives no file of a known type.")
    return [dict(zip(files, sample, strict=True)) for sample in zip(*files.values(), strict=True)]


def _files(value: str) -> list[str]:
    """A file, or what lies in a folder or matches a pattern, ordered by name with 2 before 10."""
    path = Path(value).expanduser()
    if path.is_file() or not (path.is_dir() or has_magic(value)):
        return [value]
    pattern = f"{path}/*" if path.is_dir() else str(path)
    found = glob(pattern, recursive=True)  # noqa: PTH207  (may be absolute)
    known = [each for each in found if Path(each).suffix.lower() in (*TRACES, *PHOTOS)]
    return sorted(known, key=lambda each: re.sub(r"\d+", lambda n: n[0].zfill(20), Path(each).stem))


if __name__ == "__main__":
    sys.exit(main())
