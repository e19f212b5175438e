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
