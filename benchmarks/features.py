"""Spectrograms beside bare Fourier transforms; photos halved by the JPEG decoder.

Traces are noise, of one and three axes, brought from samples to the normalised spectrogram,
movement start included. Beside them stands ``torch.stft`` on one axis and all channels, with
nothing before or after it; its time depends more on whether its 10 MB are fresh memory than on
arithmetic.
Photos are 8-megapixel JPEGs of synthetic surfaces, as ``task=generate`` writes them.
"""

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tex_lightning.data.decode import PhotoDecoder, decode_image
from tex_lightning.features.spectrogram import SpectrogramFeatures
from tex_lightning.profiling.timing import interleaved
from tex_lightning.synthetic.dataset import SyntheticSpec, write_folder

SECONDS = (1.0, 4.8, 20.0)
RATE = 10_000
PHOTOS = SyntheticSpec(classes=4, recordings=1, seconds=1.0, photo_width=3264, photo_height=2448)
REPEATS = 40


def measure(threads: int = 2) -> dict[str, Any]:
    """Times in ms and their ratios, by axes and length of the trace, and for photos."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        with torch.inference_mode():
            cases = {
                f"{axes}_axes_{seconds:g}_s": _traces(axes, seconds)
                for axes in (1, 3)
                for seconds in SECONDS
            }
        return {"threads": threads, **cases, "photo": _photos()}
    finally:
        torch.set_num_threads(before)


def _traces(axes: int, seconds: float) -> dict[str, float]:
    trace = torch.randn(axes, int(seconds * RATE))
    linear, mel = SpectrogramFeatures(), SpectrogramFeatures(scale="mel")
    whole, blocks = SpectrogramFeatures(axes="trace"), SpectrogramFeatures(scale="mel")
    blocks.fast_spectrogram = True
    stft = partial(
        torch.stft,
        trace[0],
        linear.window_length,
        linear.hop_length,
        window=linear.window,
        center=False,
        return_complex=True,
    )
    functions = {
        "linear": lambda: linear(trace),
        "mel": lambda: mel(trace),
        "mel_in_blocks": lambda: blocks(trace),
        "linear_whole_trace": lambda: whole(trace),
        "stft_alone": stft,
    }
    found = interleaved(functions, REPEATS, warm_up=3)
    least = found["stft_alone"].median
    return {f"{name}_ms": timing.median for name, timing in found.items()} | {
        f"{name}_to_stft_ratio": found[name].median / least for name in ("linear", "mel")
    }


def _photos() -> dict[str, float]:
    decoder = PhotoDecoder()
    with tempfile.TemporaryDirectory() as folder:
        write_folder(PHOTOS, Path(folder) / "photos")
        files = sorted(Path(folder).glob("photos/*/image/*.jpg"))
        pairs = [
            [decode_image(file, decoder, fast=fast).astype(int) for fast in (False, True)]
            for file in files
        ]
        functions = {
            "full": lambda: [decode_image(file, decoder) for file in files],
            "half": lambda: [decode_image(file, decoder, fast=True) for file in files],
        }
        found = interleaved(functions, REPEATS // 4)
    difference = np.stack([np.abs(exact - fast) for exact, fast in pairs])
    return {
        "full_ms": found["full"].median / len(files),
        "half_ms": found["half"].median / len(files),
        "full_to_half_ratio": found["full"].median / found["half"].median,
        "mean_difference_of_255": float(difference.mean()),
        "p99_difference_of_255": float(np.percentile(difference, 99)),
    }


if __name__ == "__main__":
    import json

    print(json.dumps(measure(), indent=1))
