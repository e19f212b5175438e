"""Parts that networks share: layers, scaled channel counts, initialisation, the score head."""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy, deepcopy
from typing import Any, Literal, NamedTuple, TypeVar, cast

import torch
from torch import Tensor, nn
from torch.nn.functional import pad
from torch.utils._pytree import tree_leaves

from tex_lightning.core.devices import has_to_repeat
from tex_lightning.errors import UserError

ScoreLayer = nn.Linear | nn.Conv1d | nn.Conv2d
Norm = Literal["batch", "lrn", "none"]
Level = Literal["fc2", "fc3"]

WIDTH = "(0, 8]"
PROBABILITY = "[0, 1)"
MEAN = (0.485, 0.456, 0.406)  # of ImageNet's photos, R G B in [0, 1]
STD = (0.229, 0.224, 0.225)
NORMS: tuple[Norm, ...] = ("batch", "lrn", "none")
PACKAGE = "tex_lightning"
KNOWN = (PACKAGE, "torch", "kornia")  # whose classes this package's parts consist of


class Window(NamedTuple):
    """Geometry along one axis of a convolution or pooling that changes the size.

    Attributes:
        kernel: Length of the window.
        stride: From one place to the next.
        padding: At either end.
        ceil: Whether a place at the far end may lack elements.
        beyond: Padding at the far end only, besides.
    """

    kernel: int
    stride: int = 1
    padding: int = 0
    ceil: bool = False
    beyond: int = 0

    def output(self, size: int) -> int:
        """Return how many places the window takes on an axis of ``size``; 0 if it does not fit."""
        room = size + 2 * self.padding + self.beyond - self.kernel
        steps = -(-room // self.stride) if self.ceil else room // self.stride
        return max(0, steps + 1) if size > 0 else 0

    def max_pool(self) -> nn.MaxPool2d:
        """Return the max pooling of this geometry."""
        return nn.MaxPool2d(self.kernel, self.stride, self.padding, ceil_mode=self.ceil)

    def average_pool(self) -> nn.Sequential:
        """Return the average over its places: over rows, then columns, by far fewer additions."""
        return nn.Sequential(
            nn.AvgPool2d((self.kernel, 1), (self.stride, 1)),
            nn.AvgPool2d((1, self.kernel), (1, self.stride)),
        )


class SameConv2d(nn.Conv2d):
    """Convolution padded like TensorFlow's "same" at even sizes, whatever the size.

    At a stride of 2 TensorFlow divides the padding by the parity of the size, which moves the whole
    grid with one more row or column: no crop would see what it sees in its image.

    Its window is made by :meth:`geometry`, and its other arguments are PyTorch's.

    Attributes:
        beyond: Zeros below and to the right, besides ``padding``.
    """

    def __init__(self, inputs: int, outputs: int, window: Window, groups: int, bias: bool) -> None:
        kernel, stride, padding, _, beyond = window
        super().__init__(inputs, outputs, kernel, stride, padding, groups=groups, bias=bias)
        self.beyond = beyond

    @staticmethod
    def geometry(kernel: int, stride: int) -> Window:
        """Return the window of an odd kernel and a stride of 1 or 2."""
        return Window(kernel, stride, (kernel - stride) // 2, beyond=stride - 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, inputs, M, N) to (B, outputs, M // stride, N // stride)."""
        return super().forward(pad(x, (0, self.beyond, 0, self.beyond)) if self.beyond else x)


def is_builtin(part: nn.Module) -> bool:
    """Return whether a part is this package's, and no module in it is of another."""
    packages = [type(module).__module__.partition(".")[0] for module in part.modules()]
    return packages[0] == PACKAGE and all(package in KNOWN for package in packages)


M = TypeVar("M", bound=nn.Module)


def independent_copy(module: M) -> M:
    """Copy a module; what it keeps of a pass is copied without the graph behind it.

    Weights of ``torch.nn.utils.weight_norm`` and activations that a network keeps are results of a
    computation, which ``deepcopy`` rejects.
    """
    kept = tree_leaves([vars(part) for part in module.modules()])
    results = [x for x in kept if isinstance(x, Tensor) and x.grad_fn is not None]
    return deepcopy(module, {id(x): x.detach().clone() for x in results})


def shared_copy(module: M, **changed: nn.Module) -> M:
    """Return a module with the same submodules and weights, but for those that are given."""
    shared = copy(module)
    shared._modules = {**module._modules, **changed}
    return shared


def scaled(channels: int, width: float) -> int:
    """Scale a channel count by the width factor, keeping at least one channel."""
    return max(1, round(channels * width))


def check_norm(norm: str, allowed: Iterable[str], key: str) -> None:
    """Raise ``UserError`` naming the key ``key`` unless ``norm`` is one of ``allowed``."""
    if norm not in (allowed := tuple(allowed)):
        raise UserError(f"{key}={norm} is not possible here; choose one of {', '.join(allowed)}.")


def conv_block(
    inputs: int,
    outputs: int,
    kernel: int | tuple[int, int],
    *,
    norm: Norm,
    stride: int = 1,
    padding: int = 0,
    groups: int = 1,
) -> nn.Sequential:
    """Return convolution, batch normalisation (for norm="batch" only) and ReLU.

    Under batch normalisation the convolution has no bias, which would be subtracted again.
    """
    batch = norm == "batch"
    conv = nn.Conv2d(inputs, outputs, kernel, stride, padding, groups=groups, bias=not batch)
    normalisation = [nn.BatchNorm2d(outputs)] if batch else []
    return nn.Sequential(conv, *normalisation, nn.ReLU(inplace=True))


class ResponseNorm(nn.LocalResponseNorm):
    """PyTorch's local response normalisation, with a gradient that is deterministic on request.

    On a GPU that of PyTorch's average over channels depends on the order of its additions.
    """

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (B, C, ...) across C."""
        if not has_to_repeat(x):
            return super().forward(x)
        around = self.size // 2, (self.size - 1) // 2
        squares = pad(x.square(), (0, 0) * (x.dim() - 2) + around)
        shifted = [squares.narrow(1, first, x.shape[1]) for first in range(self.size)]
        scaled_sum = torch.stack(shifted).sum(dim=0) * (self.alpha / self.size)
        return x / (scaled_sum + self.k) ** self.beta


def response_norm(norm: Norm, alpha: float = 1e-4, k: float = 1.0) -> list[nn.Module]:
    """Return AlexNet's local response normalisation across channels, or nothing.

    Caffe's form: b_i = a_i / (k + (alpha / 5) sum_j a_j^2)^0.75 over the 5 channels around i; the
    values given here are those of Caffe's AlexNet.
    """
    return [ResponseNorm(5, alpha=alpha, beta=0.75, k=k)] if norm == "lrn" else []


def initialise(module: nn.Module) -> None:
    """Draw He-normal weights for every convolution inside ``module``, with biases at zero."""
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)


def initialise_scores(layer: nn.Conv2d | nn.Linear) -> None:
    """Draw small weights for a layer of class scores, so that training starts near uniform."""
    nn.init.normal_(layer.weight, std=0.01)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)


class Head(nn.Module):
    """Hidden 1x1 layers up to FC2, then dropout and FC3, the class scores.

    Args:
        hidden: Layers from the trunk's features to ``features`` channels after FC2's ReLU.
        features: Channel count of FC2.
        classes: Channel count of FC3.
        dropout: Probability of dropping an FC2 feature while training, in [0, 1).
    """

    def __init__(self, hidden: nn.Sequential, features: int, classes: int, dropout: float) -> None:
        super().__init__()
        self.hidden, self.dropout = hidden, dropout
        self.scores: nn.Module = nn.Identity()
        self.restore_scores(features, classes)
        initialise(hidden)
        initialise_scores(self.score_layer)

    def restore_scores(self, features: int, classes: int) -> None:
        """Put dropout and FC3, with other weights, where a fusion has removed them."""
        layer = nn.Conv2d(features, classes, 1)
        self.scores = nn.Sequential(nn.Dropout(self.dropout), layer)

    @property
    def score_layer(self) -> nn.Conv2d:
        """FC3, the 1x1 convolution from FC2's features to class scores."""
        layers = [*self.scores.children()]
        if not layers:  # a fusion on FC2 has removed them
            raise AttributeError("This head has no layer of scores.")
        layer = layers[-1]
        return cast(nn.Conv2d, layer)

    def forward(self, x: Tensor, level: Level = "fc3") -> Tensor:
        """Map trunk features (B, D, M, N) to FC2 features or to class scores before softmax."""
        hidden: Tensor = self.hidden(x)
        if level == "fc2":
            return hidden
        scores: Tensor = self.scores(hidden)
        return scores


def score_layer_of(network: nn.Module) -> ScoreLayer | None:
    """Return the ``score_layer`` of a network, which leads from FC2's features to the class scores.

    It is linear, of kernel 1 and with a bias, so that every class has a row of weights and a bias
    of its own. None of a network without one is fused on its class scores.
    """
    layer = getattr(network, "score_layer", None)
    if not isinstance(layer, ScoreLayer) or layer.bias is None:
        return None
    return layer if layer.weight[0].numel() == layer.weight.shape[1] else None


class FittedLater(nn.Module):
    """Buffers that are empty until something was found to be better by them.

    Until then they take no room in a checkpoint.

    Args:
        **shapes: Shape of each buffer; a size with a name is known once they are fitted, and is
            the same wherever it has this name.
    """

    def __init__(self, **shapes: tuple[int | str, ...]) -> None:
        super().__init__()
        self.names, self.shapes = tuple(shapes), shapes
        for name in shapes:
            self.register_buffer(name, torch.zeros(0))

    @property
    def in_use(self) -> bool:
        """Whether they were fitted."""
        return bool(self.get_buffer(self.names[0]).numel())

    def take(self, values: Mapping[str, Tensor] | None) -> None:
        """Use these values; None uses none."""
        like = self.get_buffer(self.names[0])
        for name in self.names:
            setattr(self, name, (torch.zeros(0) if values is None else values[name]).to(like))
        self.note()

    def note(self) -> None:
        """Keep what is asked often, after values were taken or loaded; here there is nothing."""

    def _load_from_state_dict(self, state: dict[str, Any], prefix: str, *rest: Any) -> None:  # noqa: ANN401
        """Take the sizes of what is loaded; checkpoints of before have none."""
        given = [state.setdefault(prefix + name, torch.zeros(0)) for name in self.names]
        sizes: dict[str, int] = {}
        for name, value in zip(self.names, given, strict=True):
            shape = self.shapes[name] if given[0].numel() else (0,)
            if not _has_shape(value, shape, sizes):
                rest[-1].append(f"{prefix}{name} has the shape {[*value.shape]}, not {[*shape]}.")
                return
        like = self.get_buffer(self.names[0])
        for name, value in zip(self.names, given, strict=True):
            setattr(self, name, torch.zeros_like(value, device=like.device))
        super()._load_from_state_dict(state, prefix, *rest)
        self.note()


def _has_shape(value: Tensor, shape: Sequence[int | str], sizes: dict[str, int]) -> bool:
    """Whether a tensor has a shape; what its named sizes are is noted, or known from before."""
    return value.ndim == len(shape) and all(
        found == (sizes.setdefault(size, found) if isinstance(size, str) else size)
        for found, size in zip(value.shape, shape, strict=True)
    )
