import numpy as np
import pytest
import torch
from conftest import trunk_node

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier, content_seed
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.decision.voting import random_pairs
from tex_lightning.errors import UserError

NETWORK = {"width": 0.1, "norm": "batch", "dropout": 0.5}


def card(kind: str, pairs: int = 200) -> Card:
    return Card(
        kind=kind,
        classes=["a", "b", "c"],
        decode=DecodeSettings().to_dict(),
        decision={"pairs": pairs, "seed": 0},
        haptic_features={} if kind == "visual" else {"axes": "frame", "scale": "mel"},
        haptic_network={} if kind == "visual" else NETWORK,
        visual_network={}
        if kind == "haptic"
        else {**NETWORK, "trunk": trunk_node("alexnet_caffe")},
        fusion={"level": "fc2"} if kind == "fusion" else {},
    )


def classifier(kind: str) -> SurfaceClassifier:
    torch.manual_seed(0)
    return SurfaceClassifier(card(kind)).eval()


def trace(seconds: float = 2.4, seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.standard_normal((1, int(seconds * 10_000))).astype(np.float32))


def photo(side: int = 260, seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.integers(0, 256, (side, side, 3)).astype(np.uint8))


def test_fragments_are_the_networks_positions():
    assert classifier("haptic").logits(trace(20.0)).shape == (3, 114)
    assert classifier("visual").logits(photo=photo(384)).shape == (3, 36)
    assert classifier("fusion").logits(trace(), photo()).shape == (3, 200)


def test_fusions_logits_are_those_of_the_stated_pairs():
    model = classifier("fusion")
    seed = content_seed(0, trace().numpy(), photo().numpy())
    with torch.no_grad():
        haptic = model.network.haptic.features(model.haptic_input(trace()), "fc2")[0]
        visual = model.network.visual.features(model.visual_input(photo()), "fc2")[0].flatten(1)
        pairs = random_pairs(haptic.shape[1], visual.shape[1], 200, seed)
        joined = torch.cat((haptic[:, pairs[:, 0]], visual[:, pairs[:, 1]]))
        expected = model.network.head(joined.T).T
        torch.testing.assert_close(model.logits(trace(), photo()), expected)


def test_the_label_depends_on_the_sample_alone():
    model = classifier("fusion")
    samples = [(trace(seed=i), photo(seed=i)) for i in range(4)]
    forwards = [model.classify(*sample) for sample in samples]
    backwards = [model.classify(*sample) for sample in reversed(samples)][::-1]
    for left, right in zip(forwards, backwards, strict=True):
        assert left.label == right.label
        assert torch.equal(left.fragments, right.fragments)


def save(model: SurfaceClassifier, path, **changes) -> None:
    state = {f"classifier.{key}": value for key, value in model.state_dict().items()}
    content = {"hyper_parameters": {"card": model.card.to_dict()}, "state_dict": state}
    torch.save({**content, **changes}, path)


@pytest.mark.parametrize("kind", ["haptic", "visual", "fusion"])
def test_a_checkpoint_rebuilds_it(tmp_path, kind):
    model = classifier(kind)
    if model.haptic_features is not None:
        model.haptic_features.fit([model.haptic_features.magnitudes(trace())])
    save(model, tmp_path / "m.ckpt")
    again = SurfaceClassifier.from_checkpoint(tmp_path / "m.ckpt", kind)
    given = {"trace": trace(), "photo": photo()}
    torch.testing.assert_close(model.logits(**given), again.logits(**given), rtol=0, atol=0)
    assert again.card == model.card
    assert not again.training


def test_an_older_checkpoint_has_the_features_that_there_were(tmp_path):
    model = classifier("haptic")
    older = {**model.card.to_dict(), "haptic_features": {"normalisation": "standard"}}
    save(model, tmp_path / "m.ckpt", hyper_parameters={"card": older})
    features = SurfaceClassifier.from_checkpoint(tmp_path / "m.ckpt").haptic_features
    assert (features.axes, features.scale) == ("trace", "linear")


def test_foreign_damaged_and_mistaken_checkpoints_are_refused(tmp_path):
    path = tmp_path / "m.ckpt"
    model = classifier("haptic")
    for changes in ({"state_dict": {}}, {"hyper_parameters": {"lr": 1}}, {"hyper_parameters": 3}):
        save(model, path, **changes)
        with pytest.raises(UserError, match="damaged or was not written by tex_lightning"):
            SurfaceClassifier.from_checkpoint(path)
    save(model, path)
    with pytest.raises(UserError, match="holds a haptic network where a visual network"):
        SurfaceClassifier.from_checkpoint(path, "visual")
    with pytest.raises(UserError, match="does not exist"):
        SurfaceClassifier.from_checkpoint(tmp_path / "none.ckpt")


def test_too_short_too_small_and_missing_are_said():
    with pytest.raises(UserError, match=r"2\.26 s|1\.81 s for one fragment"):
        classifier("haptic").logits(trace(1.8))
    assert classifier("haptic").logits(trace(1.81)).shape == (3, 1)
    with pytest.raises(UserError, match=r"198x198 pixels .* needs 199 on each side"):
        classifier("visual").logits(photo=photo(198))
    with pytest.raises(UserError, match="give image=FILE too"):
        classifier("fusion").logits(trace())
