"""Batches for training and samples for validation.

A training batch depends on the seed and its number alone, and not on the number of loader processes
or on an interruption.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from lightning import LightningDataModule
from torch.utils.data import DataLoader, Dataset, SequentialSampler

from tex_lightning.data.banks import WHOLE, Bank, Indices
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import class_indices
from tex_lightning.data.store import Store, load_sample

Batch = dict[str, Any]  # tensors, and mappings of them
UNSEEN = 1 << 32  # keeps the streams of epochs apart from those of batches


@dataclass
class TrainingBatches(Dataset[Batch]):
    """Training batches by number, without end.

    Recordings are taken in random permutations, so that each is taken once before any is repeated.
    With several senses, the sense with most recordings is permuted, and each of its recordings is
    paired with random recordings of the same class by the others.

    Attributes:
        banks: By sense the bank of its recordings, and their class indices.
        batch_size: Samples in a batch.
        seed: Seed of everything random.
        share: The part of every batch that this process gets. Random numbers are drawn for the
            whole batch, so that the shares of several processes make the batch of one process.
    """

    banks: Mapping[str, tuple[Bank, Indices]]
    batch_size: int
    seed: int
    share: slice = field(default_factory=lambda: WHOLE)

    def __getitem__(self, step: int) -> Batch:
        """Assemble batch ``step``: ``label``, and by the name of each sense its bank's pieces."""
        rng = np.random.default_rng([self.seed, step])
        leader, *others = sorted(
            self.banks, key=lambda name: len(self.banks[name][1]), reverse=True
        )
        labels = self.banks[leader][1]
        chosen = {leader: self._next_in_permutation(step, len(labels))}
        wanted = labels[chosen[leader]]
        for name in others:
            chosen[name] = _partners(wanted, self.banks[name][1], rng)
        batch: Batch = {"label": torch.from_numpy(wanted[self.share])}
        for name, (bank, _) in self.banks.items():
            batch[name] = bank.cut(chosen[name], rng, self.share)
        return batch

    def _next_in_permutation(self, step: int, count: int) -> Indices:
        positions = step * self.batch_size + np.arange(self.batch_size)
        rounds = {
            number: np.random.default_rng([self.seed, UNSEEN + number]).permutation(count)
            for number in np.unique(positions // count).tolist()
        }
        return np.array([rounds[place // count][place % count] for place in positions])


class EpochSampler(SequentialSampler):
    """Numbers of the batches of one epoch, in their order.

    The epoch is read when an iteration begins: Lightning fetches the first batch of a resumed run
    before it sets the epoch of samplers.
    """

    def __init__(self, steps: int, current_epoch: Callable[[], int]) -> None:
        self.steps = steps
        self.current_epoch = current_epoch

    def __iter__(self) -> Iterator[int]:
        epoch = self.current_epoch()
        return iter(range(epoch * self.steps, (epoch + 1) * self.steps))

    def __len__(self) -> int:
        return self.steps


class SampleSet(Dataset[Batch]):
    """Whole decoded samples to classify: ``label``, and ``recordings`` by modality."""

    def __init__(self, samples: Sequence[Sample], store: Store, classes: list[str]) -> None:
        self.samples = samples
        self.store = store
        self.labels = class_indices([sample.label for sample in samples], classes)

    def __getitem__(self, index: int) -> Batch:
        sample = self.samples[index]
        label = torch.tensor(self.labels[index])
        return {"label": label, "recordings": load_sample(sample, self.store)}

    def __len__(self) -> int:
        return len(self.samples)


class SurfaceData(LightningDataModule):
    """Loaders of training batches, and of whole samples for validation.

    Args:
        batches: Endless sequence of batches, divided into epochs.
        steps: Batches in an epoch.
        validation: Whole samples; None disables validation.
        num_workers: Processes that make batches; 0 makes them in this one.

    Example:
        >>> import numpy as np, tex_lightning as tl, torch
        >>> from tex_lightning.data.banks import InputBank
        >>> from tex_lightning.data.datamodule import TrainingBatches
        >>> bank = InputBank([torch.rand(1, 50, 300) for _ in range(4)], frames=192)
        >>> traces = bank, np.array([0, 0, 1, 1])  # their classes
        >>> batches = TrainingBatches({"haptic": traces}, batch_size=2, seed=0)
        >>> data = tl.SurfaceData(batches, steps=5, validation=None, num_workers=0)
        >>> [batch["haptic"]["input"].shape for batch in data.train_dataloader()][4]
        torch.Size([2, 1, 50, 192])
    """

    def __init__(
        self,
        batches: TrainingBatches,
        steps: int,
        validation: SampleSet | None,
        num_workers: int,
    ) -> None:
        super().__init__()
        self.batches = batches
        self.steps = steps
        self.validation = validation
        self.num_workers = num_workers

    def train_dataloader(self) -> DataLoader[Batch]:
        """Return a loader of one epoch, with this process's share of each batch.

        Network inputs and photos are copied to a device other than the CPU if it has room for
        them, unless other processes make the batches.
        """
        if self._device.type != "cpu" and self.num_workers == 0:
            for bank, _ in self.batches.banks.values():
                bank.hold(self._device)
        return DataLoader(
            replace(self.batches, share=self._share()),
            batch_size=None,
            sampler=EpochSampler(self.steps, self._current_epoch),
            num_workers=self.num_workers,
            persistent_workers=self.num_workers > 0,
            generator=torch.Generator(),  # else every new iterator draws from dropout's generator
            pin_memory=self._device.type == "cuda",  # from where NVIDIA's GPUs copy fastest
        )

    def teardown(self, stage: str) -> None:
        """Release what the device holds."""
        for bank, _ in self.batches.banks.values():
            bank.held = None

    def _current_epoch(self) -> int:
        # `trainer.current_epoch` is corrected only after a resumed run's first batch is fetched
        if self.trainer is None or self.trainer.overfit_batches:  # type: ignore[attr-defined]
            return 0  # to overfit means the same batches in every epoch
        progress = self.trainer.fit_loop.epoch_progress.current
        return int(progress.processed)  # type: ignore[attr-defined]  # annotated as its base

    @property
    def _device(self) -> torch.device:
        return torch.device("cpu") if self.trainer is None else self.trainer.strategy.root_device

    def _share(self) -> slice:
        """Return the samples of this process: every ``world_size``-th, from its rank on."""
        if self.trainer is None:
            return WHOLE
        return slice(self.trainer.global_rank, None, self.trainer.world_size)

    def transfer_batch_to_device(
        self, batch: Batch, device: torch.device, dataloader_idx: int
    ) -> Batch:
        """Move a batch to the device, and cut there what the device holds.

        A validation sample stays on the CPU, where it seeds the tuples of a fusion and a large
        photo is divided into tiles, as in testing.
        """
        if "recordings" in batch:
            return batch
        moved: Batch = super().transfer_batch_to_device(batch, device, dataloader_idx)
        banks = self.batches.banks.items()
        cut = {name: bank.cut_there(moved[name]) for name, (bank, _) in banks}
        return {**moved, **cut}

    def val_dataloader(self) -> DataLoader[Batch] | list[Any]:
        """Return a loader of the validation samples, one at a time, since their sizes differ.

        If there are fewer samples than processes, a process without a sample reads all of them.
        Without any samples the result is an empty list.
        """
        samples = self.validation
        if not samples:
            return []
        numbers = range(len(samples))
        return DataLoader(
            samples,
            batch_size=None,
            sampler=numbers[self._share()] or numbers,
            generator=torch.Generator(),
        )


def _partners(labels: Indices, pool: Indices, rng: np.random.Generator) -> Indices:
    """Return for each label a random index of the same label in ``pool``."""
    order = np.argsort(pool, kind="stable")
    first, last = (np.searchsorted(pool[order], labels, side=side) for side in ("left", "right"))
    return order[rng.integers(first, last)]
