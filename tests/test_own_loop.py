"""The package's recordings and networks in a Lightning loop of one's own."""

import subprocess
import sys

import lightning
import pytest
import torch
from torch.nn.functional import cross_entropy

import tex_lightning as tl


class Loop(lightning.LightningModule):
    """HapticNet in plain Lightning."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.network, self.correct = tl.HapticNet(classes, width=0.25), []

    def training_step(self, batch, batch_idx):
        scores = self.network(batch[0])
        return cross_entropy(scores, batch[1][:, None].expand(-1, scores.shape[2]))

    def test_step(self, batch, batch_idx):
        self.correct.append(bool(self.network(batch[0]).mean(-1).argmax() == batch[1]))

    def configure_optimizers(self):
        return torch.optim.AdamW(self.parameters(), 2e-3)


@pytest.fixture
def given(surfaces, cache):
    return ["data=folder", f"data.root={surfaces}", f"data.cache_dir={cache}", "trainer.threads=1"]


def trainer(**flags):
    return lightning.Trainer(
        logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False, num_sanity_val_steps=0, accelerator="cpu", **flags,
    )  # fmt: skip


@pytest.mark.filterwarnings("ignore")  # of Lightning, on loaders and missing steps
def test_hapticnet_learns_in_a_loop_of_ones_own(given):
    torch.manual_seed(0)
    steps = [
        "data.val_fold=null",
        "model.haptic.fit.steps_per_epoch=10",
        "model.haptic.fit.frames=192",
    ]
    data = tl.data("model=haptic", *given, *steps)
    loop = Loop(len(data.classes))
    trainer(max_epochs=3).fit(loop, data)
    trainer().test(loop, data, verbose=False)
    assert len(loop.correct) == 3
    assert sum(loop.correct) == 3


def test_batches_are_pairs_of_inputs_and_labels(given):
    data = tl.data("model=fusion", *given, "data.half_scale=false", "data.resize=null")
    inputs, labels = next(iter(data.train_dataloader()))
    assert [(name, *x.shape[:2]) for name, x in inputs.items()] == [
        ("haptic", 16, 1),
        ("visual", 16, 3),
    ]
    assert (labels.dtype, labels.shape) == (torch.int64, (16,))
    assert data.classes == ["alpha", "beta", "gamma"]
    inputs, labels = next(iter(data.test_dataloader()))
    assert inputs["visual"].shape == (1, 3, 240, 240)
    assert (inputs["haptic"].shape[:3], labels.shape) == ((1, 1, 50), (1,))


@pytest.mark.parametrize("wrong", ["model=mfcc_nb", "task=crossval", "modle=haptic"])
def test_what_is_no_network_to_train_is_refused(given, wrong):
    with pytest.raises(tl.UserError, match=r"a network for training|did you mean model"):
        tl.data(wrong, *given)


def test_the_package_of_the_same_name_is_still_one():
    code = (
        "import tex_lightning.data.folds as f; import tex_lightning as tl; print(f.split, tl.data)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "function split" in found.stdout
    assert "module 'tex_lightning.data'" in found.stdout
