"""Arguments of the classes that configuration files name, with their ranges, by name.

A class of this package may take them wherever a ``_target_`` names it. Keys of ``model`` and
``data`` that such a class takes as well, such as ``width``, stand there.
"""

from dataclasses import dataclass

from tex_lightning.config.fit import LARGEST
from tex_lightning.config.keys import key

COUNT = {"least": 1, "most": 1_000_000}
SOME = {"least": 1, "most": 4096}
POSITIVE = {"above": 0, "most": 1_000_000}


@dataclass
class PartArguments:
    """Arguments beside the keys of ``model`` and ``data``."""

    # decoders
    channel: int | None = key(
        "channel of a sound, or column of a table beside its time, counted from 0; null reads all",
        least=0, most=4096,
    )  # fmt: skip
    # optimisers
    weight_decay: float = key("decay of the weights in a step", least=0, most=10)
    # features and networks
    windows: list[float] = key(
        "lengths of the windows", filled=True, unit="s", least=0.001, most=10
    )
    bands_per_octave: int = key("bands in an octave", least=1, most=96)
    thresholds: int = key("thresholds of a band", least=1, most=64)
    fragment_seconds: float = key("length of a fragment", unit="s", least=0.01, most=600)
    # baselines
    highest_hz: float = key("upper end of the filters", unit="Hz", above=0, most=500_000)
    filters: int = key("number of filters", least=1, most=1000)
    spacing: str = key("how filters follow each other", choices=("mel", "decreasing"))
    first: int = key("first cepstral coefficient", least=1, most=1000)
    last: int = key("last cepstral coefficient", least=1, most=1000)
    components: int = key("Gaussians of a mixture", **SOME)
    min_variance: float = key("smallest variance of a Gaussian", above=0, most=1000)
    patches: int = key("patches that the filters are learnt from", **COUNT)
    sparsity: float = key("mean activation of the auto-encoder", above=0, below=1)
    max_side: int = key(
        "largest side of a photo; larger ones are made smaller",
        unit="pixels", least=32, most=LARGEST,
    )  # fmt: skip
    scales: list[float] = key(
        "sizes of a photo, as exponents of two", filled=True, least=-8, most=4
    )
    photos: int = key("photos that the Gaussians are fitted to", **COUNT)
    descriptors: int = key("descriptors of each of these photos", **COUNT)
    cost: float = key("C of the support vector machines", **POSITIVE)
    strengths: list[float] = key("values of C to choose from", filled=True, **POSITIVE)
    radii: list[int] = key("radii of the patterns", filled=True, unit="pixels", least=1, most=64)
    kernels: int = key("number of features", least=84, most=1_000_000)
    threads: int = key("threads of the fit", least=1, most=1024)
    hydra_kernels: int = key("kernels of a group", **SOME)
    hydra_groups: int = key("groups at every dilation", **SOME)
