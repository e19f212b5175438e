"""What a device takes for each model: fits, steps, labels, batches, the dense pass, copies.

``python -m benchmarks device --models=model=fusion,model=sound --overrides="data.classes=8"``

Every network is trained by its recipe, on synthetic surfaces unless ``--overrides`` say other data,
and classifies a tested sample. ``fit_s`` is the time of a training with its validations,
``steps_per_s`` that of the last epoch. ``recordings_per_s`` goes from decoded recordings to class
scores, ``--batch`` of them at once. ``dense_speedup`` is the time of classifying window by window
to that of the dense pass on a rendered recording (``profile.seconds``, ``profile.width``), as in
the paper's table (9.5 for haptic and 51.2 for visual, on a GTX 860M). ``batch_ms`` is the pass of a
network over a batch, ``steps_per_s_bf16`` that of a whole training in that precision. Copies of a
step and a label are counted by the profiler, with their ms. Rows that take an NVIDIA GPU say so
where there is none.
"""

import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar

import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor

from benchmarks._classifiers import configured
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.core.devices import keep_memory, pick_device, synchronise, use_tf32
from tex_lightning.core.environment import environment
from tex_lightning.data.folds import make_samples
from tex_lightning.data.store import load_sample
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate
from tex_lightning.learning.train import train_networks
from tex_lightning.networks.blocks import independent_copy
from tex_lightning.senses.base import Sense
from tex_lightning.studies.fold import open_training
from tex_lightning.studies.profile import only_sense, profile_network, render_recording
from tex_lightning.studies.timing import interleaved, waiting

MODELS = "model=fusion,model=sound,model=visual_efficientnet,experiment=few/haptic"
NO_CUDA = "not measured: no CUDA"
PRECISIONS = {
    "tf32": ("trainer.tf32=true",),
    "bf16": ("trainer.precision=bf16-mixed",),
    "fp16": ("trainer.precision=16-mixed",),
}
PROFILED = {  # names of profile_network, and here
    "reference_ms": "dense_ms",
    "sliding_window_ms": "windows_ms",
    "speedup": "dense_speedup",
    "speedup_same_engine": "dense_speedup_same_engine",
}
REPEATS = 20
compiled = cache(torch.compile)
Figures = dict[str, Any]


class Steps(Callback):
    """Time the steps of the last epoch, and count the copies of CUDA in the one before."""

    made: ClassVar[list["Steps"]] = []

    def __init__(self) -> None:
        self.figures: Figures = {}
        self.made.append(self)

    def on_train_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: object,
        batch: object,
        step: int,
    ) -> None:
        last, device = int(trainer.num_training_batches) - 1, pl_module.device
        left = int(trainer.max_epochs or 0) - trainer.current_epoch - 1
        if last < 1 or step not in (0, last) or left > 1:
            return
        synchronise(device)
        if left and device.type == "cuda":
            self._profile(step, last)
        elif not left and step:
            self.figures["steps_per_s"] = last / (time.perf_counter() - self.begun)
        self.begun = time.perf_counter()

    def _profile(self, step: int, last: int) -> None:
        if step:
            self.profile.stop()
            self.figures["copies_per_step"] = copies(self.profile.key_averages(), last)
        else:
            self.profile = torch.profiler.profile()
            self.profile.start()


def copies(events: Iterable[Any], calls: int = 1) -> Figures:
    """Number and time in ms of the copies to and from a GPU, per call."""
    figures, known = {}, list(events)
    for way, name in (("to", "Memcpy HtoD"), ("from", "Memcpy DtoH")):
        found = [event for event in known if event.key.startswith(name)]
        figures[way] = sum(event.count for event in found) / calls
        figures[f"{way}_ms"] = sum(event.self_device_time_total for event in found) / 1000 / calls
    return figures


def measure(
    models: str = MODELS, overrides: str = "", accelerator: str = "auto", batch: str = "16"
) -> dict[str, Any]:
    """Figures by model and network, and the device."""
    keep_memory()
    device, figures = pick_device(accelerator), dict[str, Any]()
    common = f"trainer.accelerator={accelerator}", "weights=null", *overrides.split()
    for model in models.split(","):
        name = model.rpartition("=")[2]
        figures[name] = _model(device, int(batch), model, *common)
    return {"device": environment(device)["device"], **figures}


def _model(device: torch.device, batch: int, *settings: str) -> dict[str, Figures]:
    """Figures of a model by network, with those of its trainings in other precisions."""
    figures, cuda = _trained(configured(*settings), device, batch), device.type == "cuda"
    for name, precision in PRECISIONS.items():
        other = _trained(configured(*settings, *precision), device, None) if cuda else {}
        for kind, found in figures.items():
            if "steps_per_s" in found:
                found[f"steps_per_s_{name}"] = other.get(kind, {}).get("steps_per_s", NO_CUDA)
                found.setdefault("copies_per_step", NO_CUDA)
    return figures


def _trained(config: Config, device: torch.device, batch: int | None) -> dict[str, Figures]:
    """Train the networks of a model, and measure what was trained if there is a batch size."""
    use_tf32(config.trainer.tf32)
    steps = {"steps": {"_target_": "benchmarks.device.Steps"}}
    config, figures = replace(config, logger={}, callbacks=steps), {}
    with tempfile.TemporaryDirectory() as name:
        dataset = open_training(config, Path(name))
        parts, store = dataset.parts(config.data), dataset.store
        trained = train_networks(config, dataset.classes, parts, store, Path(name))
        for _, classifier in trained:
            kind, found = classifier.card.kind, Steps.made[-1].figures
            figures[kind] = {"fit_s": classifier.card.training["fit_seconds"], **found}
            if batch is not None:
                sample = load_sample(make_samples(parts.test, classifier.card.modalities)[0], store)
                figures[kind] |= _classifying(classifier.eval().to(device), sample, config, batch)
    return figures


@torch.inference_mode()
def _classifying(
    classifier: SurfaceClassifier, sample: dict[str, Tensor], config: Config, batch: int
) -> Figures:
    """Figures of classifying a sample, and a batch of the same."""
    fast, device = accelerate(classifier, config.engine), classifier.device

    def scores() -> None:
        for name, sense in fast.senses.items():
            x = network_inputs(sense, sample[sense.modality], batch)
            sense.score(x, fast.embedding_layer(name))

    label = waiting(partial(fast.classify, **sample), device)
    calls = {"label": label, "scores": waiting(scores, device)}
    timings = interleaved(calls, REPEATS, warm_up=3)
    figures = {
        "label_ms": timings["label"].median,
        "label_p95_ms": timings["label"].p95,
        "recordings_per_s": 1000 * batch / timings["scores"].median,
        "copies_per_label": NO_CUDA,
    }
    if device.type == "cuda":
        with torch.profiler.profile() as profile:
            label()
        figures["copies_per_label"] = copies(profile.key_averages())
    return figures | (_alone(classifier, sample, config, batch) if len(fast.senses) == 1 else {})


def network_inputs(sense: Sense, recording: Tensor, count: int) -> Tensor:
    """Inputs (count, ...) of so many recordings; photos are read as one batch."""
    if sense.medium == "photo":
        return sense.compute_features(recording.permute(2, 0, 1).expand(count, -1, -1, -1))
    return torch.cat([sense.compute_features(recording) for _ in range(count)])


def _alone(
    classifier: SurfaceClassifier, sample: dict[str, Tensor], config: Config, batch: int
) -> Figures:
    """The dense pass of one network against its windows, and its batches by precision."""
    sense, device = only_sense(classifier), classifier.device
    rendered = torch.from_numpy(render_recording(sense, config.profile, config.seed).copy())
    try:
        found = profile_network(classifier, [rendered], config.engine, config.profile)
        figures = {key: found[name] for name, key in PROFILED.items()}
    except UserError as error:
        figures = {"dense_speedup": f"not measured: {error}"}
    ways = passes(sense, network_inputs(sense, sample[sense.modality], batch))
    if device.type == "cuda":
        timed = {name: waiting(way, device) for name, way in ways.items()}
    else:
        timed = {"fp32": ways["fp32"]}
    timings = interleaved(timed, REPEATS, warm_up=3)
    ms = {name: timings[name].median if name in timings else NO_CUDA for name in ways}
    return {**figures, "batch_ms": ms}


def passes(sense: Sense, x: Tensor) -> dict[str, Callable[[], Tensor]]:
    """Passes of the network as trained over inputs (batch, ...), by precision or layout."""
    network: Any = sense.network
    run = partial(network.features, x, "fc3")

    def mixed(dtype: torch.dtype) -> Tensor:
        with torch.autocast(x.device.type, dtype):
            return run()

    def tf32() -> Tensor:
        use_tf32(True)
        scores: Tensor = run()
        use_tf32(False)
        return scores

    ways = {
        "fp32": run,
        "tf32": tf32,
        "bf16": partial(mixed, torch.bfloat16),
        "fp16": partial(mixed, torch.float16),
        "compiled": lambda: compiled(network.features)(x, "fc3"),
    }
    if x.dim() == 4:
        last: Any = independent_copy(network).to(memory_format=torch.channels_last)
        layout = x.contiguous(memory_format=torch.channels_last)
        ways["channels_last"] = partial(last.features, layout, "fc3")
    return ways
