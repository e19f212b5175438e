"""Where recordings come from."""

from dataclasses import dataclass, field

from omegaconf import MISSING


@dataclass
class SyntheticConfig:
    """Synthetic surfaces: recordings per class, their seed and size (seconds, pixels)."""

    recordings: int = MISSING
    seed: int = MISSING
    seconds: float = MISSING
    photo_width: int = MISSING
    photo_height: int = MISSING


@dataclass
class DataConfig:
    """Where recordings come from, how they are decoded and divided into folds."""

    name: str = MISSING
    root: str | None = MISSING
    manifest: str | None = MISSING
    split: str | None = None
    group_by: str | None = None
    classes: int | None = None
    synthetic: SyntheticConfig = field(default_factory=SyntheticConfig)
    sampling_rate: float = MISSING
    file_rate: float | None = None
    half_scale: bool = MISSING
    resize: int | None = None
    folds: int = MISSING
    test_fold: int | None = MISSING
    val_fold: int | None = None
    inverted: bool = MISSING
    hold_out: list[str] | None = None
    skip_bad: bool = MISSING
    cache_dir: str | None = None
    num_workers: int = MISSING
