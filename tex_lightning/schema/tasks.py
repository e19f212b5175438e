"""How fragments are decided on, networks are run, and each task is told what to do."""

from dataclasses import dataclass, field

from omegaconf import MISSING


@dataclass
class DecisionConfig:
    """How fragments become one label.

    Attributes:
        name: max_vote asks every fragment, sequential as few as the label needs.
        pairs: FusionNet's K.
        rule: vote lets every fragment vote, mean averages their class probabilities; a checkpoint
            keeps the rule it was trained with.
        seed: Of the pairs, and of the order in which windows of a photo are drawn.
        reject_below: Mean class probability below which no label is given.
        alpha: Most chance that the windows left out would change the label; 0 takes no chance.
        enough: Mean probability at which one modality, or the beginning of a trace, decides.
        calibrated: Whether a checkpoint's own threshold takes the place of ``enough``.
        disagreement: Share of decisions differing from the full one that this threshold may have.
        confidence: Of the bound on that share.
        alphas: Drawn in the curves.
        enoughs: Drawn in the curves, and those that the threshold is chosen among.
    """

    name: str = MISSING
    pairs: int = MISSING
    rule: str = MISSING
    seed: int = MISSING
    reject_below: float | None = None
    alpha: float = MISSING
    enough: float = MISSING
    calibrated: bool = MISSING
    disagreement: float = MISSING
    confidence: float = MISSING
    alphas: list[float] = MISSING
    enoughs: list[float] = MISSING


@dataclass
class TrainerConfig:
    """Passed to Lightning's Trainer.

    Attributes:
        accelerator: Kind of device.
        devices: How many of each machine train one network together; None takes every GPU.
        num_nodes: How many machines do.
        precision: Of training.
        threads: Of PyTorch on the CPU; None leaves its choice.
    """

    accelerator: str = MISSING
    devices: int | None = MISSING
    num_nodes: int = MISSING
    precision: str = MISSING
    threads: int | None = None


@dataclass
class EngineConfig:
    """How a trained network is run in testing and prediction; its weights stay what they are.

    Attributes:
        fold_batch_norm: Batch normalisation becomes part of the convolution before it.
        fast_response_norm: Local response normalisation in a form that stays in the cache.
        fast_convolutions: On the CPU in fp32, 3x3 convolutions over long traces and photos with
            half the multiplications, and HapticNet's 4x12 one as matrix products.
        channels_last: Weights with the channels innermost, as decoded photos have them.
        fast_spectrogram: On the CPU, spectrograms in blocks, or by matrix products.
        precision: Of convolutions, fp32 or bf16; class scores are float32 with either.
        compile: Whether ``torch.compile`` fuses layers.
        tile: Most pixels, or frames times 50 channels, that go through a network at once; larger
            inputs go in pieces. None never divides.
    """

    fold_batch_norm: bool = MISSING
    fast_response_norm: bool = MISSING
    fast_convolutions: bool = MISSING
    channels_last: bool = MISSING
    fast_spectrogram: bool = MISSING
    precision: str = MISSING
    compile: bool = MISSING
    tile: int | None = MISSING


@dataclass
class LoggerConfig:
    """Whether TensorBoard events and their figures are written beside the CSV of metrics."""

    tensorboard: bool = MISSING


@dataclass
class CrossvalConfig:
    """Cross-validation.

    Attributes:
        only: Which folds are run; None means all.
        profile: Unimodal models whose speed is profiled afterwards.
        share: Folder in which runs side by side find each other's networks, so that each is
            trained once whatever it is fused into and however it decides; None shares nothing.
    """

    only: list[int] | None = None
    profile: list[str] = MISSING
    share: str | None = None


@dataclass
class PredictConfig:
    """Whether task=predict lets the JPEG decoder halve photos, faster and nearly the same."""

    fast_decode: bool = MISSING


@dataclass
class StreamConfig:
    """Seconds of signal that task=stream takes at once, and that may wait; axes of a pipe."""

    chunk: float = MISSING
    wait: float = MISSING
    axes: int = MISSING


@dataclass
class GenerateConfig:
    """Where synthetic surfaces are written out and in which layout (folder or tum)."""

    out: str = MISSING
    layout: str = MISSING


@dataclass
class PretrainConfig:
    """The stream of ``task=pretrain``.

    Attributes:
        views: How often a rendered specimen is viewed before it is gone.
        test: Specimens that the network is tested on; training meets none of them.
    """

    views: int = MISSING
    test: int = MISSING


@dataclass
class ProfileConfig:
    """What ``task=profile`` measures and how long it may take.

    Attributes:
        classes: Of a network with random weights.
        seconds: Length of the rendered trace.
        width: Of the rendered photo in pixels, as the network sees it.
        height: The same.
        rounds: Most rounds in which everything is timed by turns.
        budget_s: No further round begins after so many seconds; three are always run.
        growth: Whether to measure how the cost grows with size, classes, pairs, batch and threads.
        max_seconds: Longest single call that ``growth`` may expect.
    """

    classes: int = MISSING
    seconds: float = MISSING
    width: int = MISSING
    height: int = MISSING
    rounds: int = MISSING
    budget_s: float = MISSING
    growth: bool = MISSING
    max_seconds: float = MISSING


@dataclass
class FrontierConfig:
    """The family of systems that ``task=frontier`` trains and measures.

    Attributes:
        systems: Overrides, separated by blanks, by the system's name; None leaves it out.
        only: Some of them; None runs all.
        rounds: Rounds of timing.
        max_latency_ms: Latency that the system to use may have; None is no limit.
        min_accuracy: Share of correct votes on the tested folds that it must have.
        run: Finished run folder that ``model=auto`` takes its choice from; None finds it first.
    """

    systems: dict[str, str | None] = field(default_factory=dict)
    only: list[str] | None = None
    rounds: int = MISSING
    max_latency_ms: float | None = None
    min_accuracy: float | None = None
    run: str | None = None


@dataclass
class StabilityConfig:
    """What ``task=stability`` tests and how thoroughly.

    Attributes:
        systems: Run folders or checkpoints.
        parts: Whether the unimodal networks beside a FusionNet are tested too.
        folds: Of a cross-validation's run folder; None takes all that it holds.
        only: Names of perturbations; None takes all.
        limit: Most test samples of a class in a fold; None takes all.
        bound: Share of the clean vote accuracy below which a system counts as broken.
        bisections: Of the stretch between two severities in which it breaks.
    """

    systems: list[str] | None = None
    parts: bool = MISSING
    folds: list[int] | None = None
    only: list[str] | None = None
    limit: int | None = None
    bound: float = MISSING
    bisections: int = MISSING
