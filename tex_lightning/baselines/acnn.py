"""A convolutional network on the raw trace that begins with a sparse auto-encoder's filters.

After Ji, Fang, Zheng, Strese and Steinbach (MLSP 2015), of which layers, window and training are
not public: those here are choices. The auto-encoder learns from raw patches.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from tex_lightning.baselines.base import Array, Baseline, State
from tex_lightning.errors import UserError

FILTER_STEPS = 200
FILTER_BATCH = 256
FILTER_LEARNING_RATE = 1e-2
FILTER_WEIGHT_DECAY = 1.0  # lets the noise of the initial weights go
SPARSITY_WEIGHT = 1.0  # of the penalty, beside the squared error of the reconstruction


def learn_filters(
    traces: Sequence[Tensor], length: int, units: int, patches: int, sparsity: float
) -> Tensor:
    """Return the weights (units, length) of the encoder, by PyTorch's global generator.

    Hidden units are sigmoids of a linear layer, the decoder is linear, and the Kullback-Leibler
    divergence between ``sparsity`` and each unit's mean activation in a batch is a penalty (Ng
    2011). Patches have no mean and, but for silence, unit deviation.

    Args:
        traces: (samples,) each, at least ``length`` long.
        length: Length of a patch in samples.
        units: Hidden units.
        patches: Number of patches that are drawn, the same from every trace.
        sparsity: Mean activation to aim at, between 0 and 1.
    """
    data = draw_patches(traces, length, patches)
    encoder, decoder = nn.Linear(length, units), nn.Linear(units, length)
    parameters = [*encoder.parameters(), *decoder.parameters()]
    optimizer = torch.optim.AdamW(
        parameters, FILTER_LEARNING_RATE, weight_decay=FILTER_WEIGHT_DECAY
    )
    for _ in range(FILTER_STEPS):
        batch = data[torch.randint(len(data), (FILTER_BATCH,))]
        hidden = encoder(batch).sigmoid()
        error = (decoder(hidden) - batch).square().mean()
        optimizer.zero_grad()
        (error + SPARSITY_WEIGHT * divergence(hidden.mean(dim=0), sparsity).mean()).backward()
        optimizer.step()
    return encoder.weight.detach()


def draw_patches(traces: Sequence[Tensor], length: int, count: int) -> Tensor:
    """Draw patches (count, length) from random places, with mean 0 and deviation 1."""
    chosen = (traces[int(torch.randint(len(traces), ()))] for _ in range(count))
    data = torch.stack([_cut(trace, length) for trace in chosen])
    data = data - data.mean(dim=1, keepdim=True)
    deviation = data.std(dim=1, keepdim=True)
    return data / torch.where(deviation > 0, deviation, 1.0)


def _cut(trace: Tensor, length: int) -> Tensor:
    """Cut a piece from a random place."""
    start = int(torch.randint(len(trace) - length + 1, ()))
    return trace[start : start + length]


def divergence(activation: Tensor, sparsity: float) -> Tensor:
    """Return the Kullback-Leibler divergence of Bernoulli variables from ``sparsity``."""
    activation = activation.clamp(1e-6, 1 - 1e-6)
    on = sparsity * torch.log(sparsity / activation)
    return on + (1 - sparsity) * torch.log((1 - sparsity) / (1 - activation))


FIRST_LENGTH, FIRST_STRIDE = 64, 8  # samples: 6.4 ms and 0.8 ms at 10 kHz
CHANNELS = (32, 64, 128)
LENGTH = 9  # of the later convolutions
POOL = 4
HIDDEN = 128
STRIDE: int = FIRST_STRIDE * POOL ** len(CHANNELS)  # samples from a fragment to the next


@dataclass
class RawNetwork(Baseline):
    """Every fragment of a trace is classified, at a stride of 512 samples, in one dense pass.

    Of a fragment, what the pooling leaves over is dropped.
    """

    fragment_seconds: Annotated[float, "(0, 3600] s", "longest fragment"]
    patches: Annotated[int, "[1, 10000000]", "raw patches that the auto-encoder learns from"]
    sparsity: Annotated[float, "(0, 1)", "mean activation of its hidden units"]  # to aim at
    steps: Annotated[int, "[1, 100000000]", "steps of training"]
    batch_size: Annotated[int, "[1, 4096]", "fragments in a step"]
    learning_rate: Annotated[float, "(0, 10]", "highest of a one-cycle schedule"]
    weight_decay: Annotated[float, "[0, 10]", "weight decay of AdamW"]
    dropout: Annotated[float, "[0, 1)", "share of hidden units left out in training"]

    kind: ClassVar = "haptic"
    budgeted: ClassVar = {"steps": 1}

    def __post_init__(self) -> None:
        if self.batch_size < 2:
            raise UserError("model.baseline.batch_size must be at least 2.")
        self.scale = 1.0

    @property
    def width(self) -> int:
        """Outputs of the last pooling that one fragment spans.

        Raises:
            UserError: If a fragment does not span one.
        """
        samples = int(self.fragment_seconds * self.sampling_rate)
        if samples < fragment_length(1):
            raise UserError(
                f"model.baseline.fragment_seconds={self.fragment_seconds:g} is less than "
                f"{fragment_length(1) / self.sampling_rate:g} s, the network's shortest; raise it."
            )
        spare = samples - fragment_length(1)
        return 1 + spare // STRIDE

    def fit(self, recordings: Sequence[Array], labels: npt.NDArray[np.int64], seed: int) -> None:
        """Fit the first filters to patches, then all layers to random fragments."""
        traces = [torch.from_numpy(np.asarray(trace, dtype=np.float32)) for trace in recordings]
        self.scale = float(torch.cat(traces).std()) or 1.0
        traces = [self._prepare(trace) for trace in traces]
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            filters = learn_filters(traces, FIRST_LENGTH, CHANNELS[0], self.patches, self.sparsity)
            self.network = make_network(int(labels.max()) + 1, self.width, self.dropout)
            self.network[0].weight.data = filters[:, None].clone()
            self._train(traces, torch.from_numpy(labels))
        self.network.eval()

    def _train(self, traces: list[Tensor], labels: Tensor) -> None:
        optimizer = torch.optim.AdamW(
            self.network.parameters(), self.learning_rate, weight_decay=self.weight_decay
        )
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, self.learning_rate, total_steps=self.steps + 1
        )
        self.network.train()
        length = fragment_length(self.width)
        for _ in range(self.steps):
            chosen = torch.randint(len(traces), (self.batch_size,))
            pieces = torch.stack([_cut(traces[int(index)], length) for index in chosen])
            scores = self.network(pieces[:, None])[..., 0]
            optimizer.zero_grad()
            loss = nn.functional.cross_entropy(scores, labels[chosen])
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()

    def _prepare(self, trace: Tensor) -> Tensor:
        """Return a trace (samples,) at the training set's scale, at least a fragment long."""
        repeats = -(-fragment_length(self.width) // len(trace))
        return (trace / self.scale).repeat(repeats)

    @torch.inference_mode()
    def logits(self, recording: Array) -> Tensor:
        """Return the class scores (classes, fragments)."""
        trace = self._prepare(torch.from_numpy(np.asarray(recording, dtype=np.float32)))
        scores: Tensor = self.network(trace[None, None])[0]
        return scores

    def state(self) -> State:
        """Return the weights and the scale of the training set."""
        return {**self.network.state_dict(), "scale": torch.tensor(self.scale, dtype=torch.float64)}

    def load_state(self, state: State) -> None:
        """Make the network that the weights are of."""
        weights = {key: value for key, value in state.items() if key != "scale"}
        self.scale = float(state["scale"])
        classes = len(list(weights.values())[-1])
        self.network = make_network(classes, self.width, self.dropout).eval()
        self.network.load_state_dict(weights)

    def count_parameters(self) -> int:
        """Count the trained numbers."""
        return sum(parameter.numel() for parameter in self.network.parameters())


def make_network(classes: int, width: int, dropout: float) -> nn.Sequential:
    """Make the layers from (batch, 1, samples) to class scores (batch, classes, fragments).

    Batch normalisation, which came in the year of the paper, lets it train in hundreds of steps.
    """
    layers: list[nn.Module] = []
    size, stride, before = FIRST_LENGTH, FIRST_STRIDE, 1
    for channels in CHANNELS:
        layers += [
            nn.Conv1d(before, channels, size, stride, bias=False),
            nn.BatchNorm1d(channels),
            nn.ReLU(),
            nn.MaxPool1d(POOL),
        ]
        size, stride, before = LENGTH, 1, channels
    hidden = nn.Conv1d(before, HIDDEN, width, bias=False)
    layers += [hidden, nn.BatchNorm1d(HIDDEN), nn.ReLU(), nn.Dropout(dropout)]
    return nn.Sequential(*layers, nn.Conv1d(HIDDEN, classes, 1))


def fragment_length(width: int) -> int:
    """Count the samples behind ``width`` neighbouring outputs of the last pooling."""
    samples = width
    for _ in range(len(CHANNELS) - 1):
        samples = samples * POOL + LENGTH - 1
    return (samples * POOL - 1) * FIRST_STRIDE + FIRST_LENGTH
