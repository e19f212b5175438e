"""A second device without its hardware: PyTorch's PrivateUse1 backend, which computes on the CPU.

A tensor on it claims another device, and every operation is checked as CUDA and MPS would: all of
its tensors are there, but for numbers of no axes in arithmetic; copies alone cross over. Results
are those of the CPU to the last bit.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import torch
from lightning import Callback, Trainer
from lightning.pytorch.accelerators import Accelerator
from lightning.pytorch.strategies import SingleDeviceStrategy
from torch.utils._python_dispatch import return_and_correct_aliasing
from torch.utils._pytree import tree_map_only
from torch.utils.backend_registration import (
    _DummyBackendModule,
    _setup_privateuseone_for_python_backend,
)

NAME = "faraway"
WIDE = (torch.float64, torch.complex128)  # MPS has neither
CROSSING = {
    torch.ops.aten.copy_.default,
    torch.ops.aten._to_copy.default,
    torch.ops.aten.set_.source_Tensor,
}

# Operations of which PyTorch wants a function of the device's own: torch.tensor asks for the first,
# and the others would be filled in after their tensor was made empty.
OWN = ("copy_", "arange", "arange.start", "arange.start_step", "linspace", "eye", "randperm")


# Operations whose result, or its size, the CPU waits for on CUDA
WAITING = {
    "_local_scalar_dense", "equal", "nonzero", "masked_select", "bincount", "_unique2",
    "unique_dim", "unique_consecutive", "repeat_interleave",
}  # fmt: skip
# Operations that CUDA refuses where deterministic algorithms are asked for: some at all, some of
# floating-point numbers; the list is that of torch.use_deterministic_algorithms
CHANCY = {
    "nll_loss2d_forward", "nll_loss2d_backward", "avg_pool3d_backward", "_ctc_loss_backward",
    "_adaptive_avg_pool2d_backward", "_adaptive_avg_pool3d_backward",
    "adaptive_max_pool2d_backward", "fractional_max_pool2d_backward", "max_unpool2d",
    "max_unpool3d", "reflection_pad1d_backward", "reflection_pad2d_backward",
    "upsample_linear1d_backward", "upsample_bilinear2d_backward", "upsample_bicubic2d_backward",
    "_upsample_bilinear2d_aa_backward", "grid_sampler_2d_backward", "histc", "median.dim",
    "nanmedian.dim", "kthvalue", "put_",
}  # fmt: skip
CHANCY_SUMS = {"cumsum"}


class MixedDevicesError(RuntimeError):
    """An operation has tensors on both devices."""


class NotDeterministicError(RuntimeError):
    """An operation gives another result each time, and was asked for the same."""


class Far(torch.Tensor):
    """A tensor on the second device; ``near`` holds its values on the CPU."""

    near: torch.Tensor

    @staticmethod
    def __new__(cls, near: torch.Tensor) -> "Far":
        if near.dtype in WIDE:
            raise TypeError(f"the second device does not support {near.dtype}")
        far = torch.Tensor._make_wrapper_subclass(
            cls,
            near.shape,
            strides=near.stride(),
            storage_offset=near.storage_offset(),
            dtype=near.dtype,
            device=f"{NAME}:0",
        )
        far.near = near
        return far

    def __repr__(self) -> str:
        return f"Far({self.near})"

    def tolist(self) -> Any:
        note("from")
        return self.near.tolist()

    def __reduce_ex__(self, protocol: Any) -> Any:
        given = self.near, self.dtype, str(self.device), self.requires_grad
        return torch._utils._rebuild_device_tensor_from_cpu_tensor, given

    @classmethod
    def __torch_dispatch__(cls, function, types, args=(), kwargs=None):
        return compute(function, *args, **(kwargs or {}))


@torch.inference_mode(False)  # in which no view of a wrapped tensor can be made
@torch.no_grad()
def compute(function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Run an operation on the second device, or a copy from or to it."""
    parts = function.decompose(*args, **kwargs)  # in inference mode nothing has done that
    if parts is not NotImplemented:
        return parts
    check(function, args, kwargs)
    wanted = kwargs.get("device")
    if (way := crossing(function, args, wanted)) is not None:
        note(way)
    there = wanted is not None and not is_near(wanted)
    given = {**kwargs, "device": torch.device("cpu")} if there else kwargs
    given = {name: near(value) for name, value in given.items()}
    out = function(*near(args), **given)
    if function.overloadpacket is torch.ops.aten._to_copy and is_near(wanted):
        return out
    if function is torch.ops.aten.copy_.default:
        return args[0]
    out = tree_map_only(torch.Tensor, Far, out)
    if any(each.alias_info is not None for each in function._schema.returns):
        out = return_and_correct_aliasing(function, args, kwargs, out)
    for far in leaves((args, [*kwargs.values()])):
        if isinstance(far, Far) and far.shape != far.near.shape:
            raise NotImplementedError(f"{function} changes the shape of a tensor of the device")
    return out


def near(value: Any) -> Any:
    """Return an argument, such as a list of tensors, with the values on the CPU."""
    if isinstance(value, list | tuple):
        return type(value)([near(each) for each in value])
    return value.near if isinstance(value, Far) else value


def leaves(values: Iterable[Any]) -> Iterator[Any]:
    """Yield what is in arguments; PyTorch's own way through them takes a while."""
    for value in values:
        if isinstance(value, list | tuple):
            yield from leaves(value)
        else:
            yield value


def is_near(wanted: torch.device | None) -> bool:
    """Whether a device is another one than this: the CPU, or ``meta``, which holds nothing."""
    return wanted is not None and torch.device(wanted).type != NAME


_noted: list[Counter[tuple[str, str]]] = []  # innermost last


@contextmanager
def noting() -> Iterator[Counter[tuple[str, str]]]:
    """Count what crosses over inside the context, by way and function of the package.

    Ways are ``to`` the device, ``from`` it, which the CPU waits for, and ``wait`` for a result
    whose value or size the CPU needs.
    """
    _noted.append(counts := Counter())
    try:
        yield counts
    finally:
        _noted.remove(counts)


def note(way: str) -> None:
    """Count a crossing at the innermost function of the package that is running."""
    if not _noted:
        return
    frame = sys._getframe(1)
    while frame is not None and "/tex_lightning/" not in frame.f_code.co_filename:
        frame = frame.f_back
    place = "elsewhere"
    if frame is not None:
        code = frame.f_code
        place = f"{Path(code.co_filename).stem}.{code.co_qualname.rpartition('.<locals>')[2]}"
    for counts in _noted:
        counts[way, place] += 1


def crossing(function: Callable[..., Any], args: Any, wanted: torch.device | None) -> str | None:
    """Return which way an operation crosses over; None if it does not."""
    packet, far = function.overloadpacket, [isinstance(each, Far) for each in args]
    if packet is torch.ops.aten._to_copy and wanted is not None and far[0] == is_near(wanted):
        return "to" if not far[0] else None if torch.device(wanted).type == "meta" else "from"
    if packet is torch.ops.aten.copy_ and far[0] != far[1]:
        return "from" if far[1] else "to"
    by_mask = packet.__name__ in ("index", "index_put", "index_put_", "_index_put_impl_") and any(
        each is not None and each.dtype in (torch.bool, torch.uint8) for each in args[1]
    )
    return "wait" if by_mask or packet.__name__ in WAITING else None


def check(function: Callable[..., Any], args: Any, kwargs: Any) -> None:
    """Refuse what a real device would.

    Raises:
        MixedDevicesError: If a tensor with axes, of float64 or that is changed lies elsewhere.
    """
    given = [*leaves((args, [*kwargs.values()]))]
    tensors = [each for each in given if isinstance(each, torch.Tensor)]
    near = [each for each in tensors if not isinstance(each, Far)]
    if any(isinstance(each, torch.Generator) for each in given):
        raise MixedDevicesError(f"{function} has a generator of the CPU")
    if torch.are_deterministic_algorithms_enabled() and is_chancy(function, tensors):
        raise NotDeterministicError(f"{function} does not have a deterministic implementation")
    if function in CROSSING or not near:
        return
    scalars = all(not each.dim() for each in near) and torch.Tag.pointwise in function.tags
    changed = function._schema.is_mutable and not isinstance(tensors[0], Far)
    if changed or not scalars or any(each.dtype in WIDE for each in near):
        shapes = [tuple(each.shape) for each in near]
        raise MixedDevicesError(f"{function} has tensors on the CPU: {shapes}")


def is_chancy(function: Callable[..., Any], tensors: list[torch.Tensor]) -> bool:
    packet = function.overloadpacket.__name__
    sums = packet in CHANCY_SUMS and tensors[0].is_floating_point()
    return sums or bool({packet, f"{packet}.{function._overloadname}"} & CHANCY)


class Module(_DummyBackendModule):
    """``torch.faraway``: its numbers are drawn by the CPU's generator."""

    def get_rng_state(self, device: object = None) -> torch.Tensor:
        return torch.get_rng_state()

    def set_rng_state(self, state: torch.Tensor, device: object = None) -> None:
        pass


_library: list[torch.library.Library] = []  # registered as long as it lives


def register() -> torch.device:
    """Make the device known to PyTorch, for as long as the process lives.

    No gradient flows there if one has flowed in the process before: PyTorch makes the threads of
    all devices with the first.
    """
    if not _library:
        _setup_privateuseone_for_python_backend(rename=NAME, backend_module=Module())
        library = torch.library.Library("_", "IMPL")
        library.fallback(compute, "PrivateUse1")
        own = torch.library.Library("aten", "IMPL")
        for name in OWN:
            packet, _, overload = name.partition(".")
            operation = getattr(getattr(torch.ops.aten, packet), overload or "default")
            own.impl(name, partial(compute, operation), "PrivateUse1")
        _library.extend((library, own))
    return torch.device(NAME, 0)


class Crossings(Callback):
    """What has crossed over between the hooks of a training, in their order.

    Attributes:
        found: ``step`` for the end of a training step, ``sample`` for that of a validated sample,
            or ``epoch``, with the counts since the last of them.
    """

    made: ClassVar[list["Crossings"]] = []

    def __init__(self) -> None:
        self.found: list[tuple[str, Counter[tuple[str, str]]]] = []
        self.made.append(self)

    def on_train_start(self, *_: Any) -> None:
        self.noting = noting()
        self.counts = self.noting.__enter__()

    def on_train_end(self, *_: Any) -> None:
        self.noting.__exit__(None, None, None)

    def on_train_batch_end(self, *_: Any) -> None:
        self._add("step")

    def on_validation_batch_end(self, *_: Any) -> None:
        self._add("sample")

    def on_train_epoch_end(self, *_: Any) -> None:
        self._add("epoch")

    def _add(self, what: str) -> None:
        self.found.append((what, Counter(self.counts)))
        self.counts.clear()


class FarAccelerator(Accelerator):
    """What Lightning wants to know of the device."""

    def setup_device(self, device: torch.device) -> None:
        pass

    def teardown(self) -> None:
        pass

    def get_device_stats(self, device: object) -> dict[str, Any]:
        return {}

    @staticmethod
    def parse_devices(devices: Any) -> Any:
        return devices

    @staticmethod
    def get_parallel_devices(devices: Any) -> list[torch.device]:
        return [torch.device(NAME, 0)]

    @staticmethod
    def auto_device_count() -> int:
        return 1

    @staticmethod
    def is_available() -> bool:
        return True

    @staticmethod
    def name() -> str:
        return NAME


def far_trainer(**flags: Any) -> Trainer:
    """Lightning's Trainer on the device, which its ``auto`` does not know."""
    there = {"accelerator": FarAccelerator(), "strategy": SingleDeviceStrategy(f"{NAME}:0")}
    return Trainer(**flags | there)


@contextmanager
def chosen() -> Iterator[torch.device]:
    """Let ``trainer.accelerator=auto`` take the second device, in every module of the package."""
    import pytest

    from tex_lightning.core import devices

    pick = devices.pick_device
    if (real := pick("auto")).type != "cpu":
        yield real
        return
    device = register()

    with pytest.MonkeyPatch.context() as patch:
        for name, module in list(sys.modules.items()):
            if name.startswith("tex_lightning") and getattr(module, "pick_device", None) is pick:
                patch.setattr(
                    module, "pick_device", lambda asked: real if asked == "cpu" else device
                )
        patch.setattr("tex_lightning.learning.trainer.Trainer", far_trainer)
        yield device
