"""A FusionNet that is the sum of its parts' class scores, without training."""

import json

import torch


def test_no_epoch_leaves_the_sum_of_both_networks_scores(run_once, surfaces):
    run = run_once(
        "model=fusion", "model.visual.width=0.1", "data=folder",
        f"data.root={surfaces}", "data.half_scale=false", "debug=tiny", "model.fusion.fit.epochs=0",
    )  # fmt: skip
    state = {
        kind: torch.load(run / f"checkpoints/{kind}.ckpt", weights_only=True)["state_dict"]
        for kind in ("haptic", "visual", "fusion")
    }
    layers = [
        next(value for name, value in state[kind].items() if name.endswith("head.scores.1.weight"))
        for kind in ("haptic", "visual")
    ]
    expected = torch.cat([layer.flatten(1) for layer in layers], dim=1)
    assert torch.equal(state["fusion"]["classifier.fusion.head.weight"], expected)
    networks = json.loads((run / "results.json").read_text())["networks"]
    assert networks["fusion"]["test_samples"] == 3


def test_a_random_head_wants_training(cli, tmp_path):
    outcome = cli(
        "model=fusion", "model.fusion.fit.epochs=0", "model.fusion.head_start=random",
        f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 2
    assert "model.fusion.fit.epochs is 0: choose 1 or more" in outcome.err
