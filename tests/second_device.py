"""A second device without its hardware: PyTorch's PrivateUse1 backend, which computes on the CPU.

A tensor on it claims another device, and every operation is checked as CUDA and MPS would: all of
its tensors are there, but for numbers of no axes in arithmetic; copies alone cross over. Results
are those of the CPU to the last bit.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import torch
from torch.utils._python_dispatch import return_and_correct_aliasing
from torch.utils._pytree import tree_leaves, tree_map_only
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


class MixedDevicesError(RuntimeError):
    """An operation has tensors on both devices."""


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
    given = {**kwargs, "device": torch.device("cpu")} if wanted is not None else kwargs
    args_near, given = tree_map_only(Far, lambda each: each.near, (args, given))
    out = function(*args_near, **given)
    if function.overloadpacket is torch.ops.aten._to_copy and is_near(wanted):
        return out
    if function is torch.ops.aten.copy_.default:
        return args[0]
    out = tree_map_only(torch.Tensor, Far, out)
    out = return_and_correct_aliasing(function, args, kwargs, out)
    for far in tree_leaves((args, kwargs)):
        if isinstance(far, Far) and far.shape != far.near.shape:
            raise NotImplementedError(f"{function} changes the shape of a tensor of the device")
    return out


def is_near(wanted: torch.device | None) -> bool:
    return wanted is not None and torch.device(wanted).type == "cpu"


def check(function: Callable[..., Any], args: Any, kwargs: Any) -> None:
    """Refuse what a real device would.

    Raises:
        MixedDevicesError: If a tensor with axes, of float64 or that is changed lies elsewhere.
    """
    leaves = tree_leaves((args, kwargs))
    tensors = [each for each in leaves if isinstance(each, torch.Tensor)]
    near = [each for each in tensors if not isinstance(each, Far)]
    if any(isinstance(each, torch.Generator) for each in leaves):
        raise MixedDevicesError(f"{function} has a generator of the CPU")
    if function in CROSSING or not near:
        return
    scalars = all(not each.dim() for each in near) and torch.Tag.pointwise in function.tags
    changed = function._schema.is_mutable and not isinstance(tensors[0], Far)
    if changed or not scalars or any(each.dtype in WIDE for each in near):
        shapes = [tuple(each.shape) for each in near]
        raise MixedDevicesError(f"{function} has tensors on the CPU: {shapes}")


class Module(_DummyBackendModule):
    """``torch.faraway``: its numbers are drawn by the CPU's generator."""

    def get_rng_state(self, device: object = None) -> torch.Tensor:
        return torch.get_rng_state()

    def set_rng_state(self, state: torch.Tensor, device: object = None) -> None:
        pass


_library: list[torch.library.Library] = []  # registered as long as it lives


def register() -> torch.device:
    """Make the device known to PyTorch, for as long as the process lives.

    No gradient flows there once one has flowed in the process: PyTorch makes the threads of all
    devices with the first.
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
                patch.setattr(module, "pick_device", lambda _: device)
        yield device
