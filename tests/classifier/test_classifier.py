import numpy as np
import pytest
import torch
from conftest import make_card, save_classifier

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.classifier.vote import random_tuples
from tex_lightning.config.instantiation import trust
from tex_lightning.core.devices import computing_threads
from tex_lightning.errors import UserError
from tex_lightning_runtime.samples import content_seed

SENSES = {
    "haptic": ["haptic"],
    "visual": ["visual"],
    "fusion": ["haptic", "visual"],
    "three": ["haptic", "visual", "sound"],
}


def classifier(kind: str, level: str = "fc2") -> SurfaceClassifier:
    torch.manual_seed(0)
    card = make_card(*SENSES[kind], level=level, pairs=200, width=0.1)
    return SurfaceClassifier(card).eval()


def trace(seconds: float = 2.4, seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.standard_normal((1, int(seconds * 10_000))).astype(np.float32))


def photo(side: int = 260, seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.integers(0, 256, (side, side, 3)).astype(np.uint8))


def sound(seconds: float = 2.4, seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng([seed, 1])
    return torch.from_numpy(rng.standard_normal((1, int(seconds * 44_100))).astype(np.float32))


def sample(seed: int = 0) -> dict[str, torch.Tensor]:
    return {"haptic": trace(seed=seed), "image": photo(seed=seed), "sound": sound(seed=seed)}


def test_fusions_logits_are_those_of_the_stated_tuples():
    model = classifier("three")
    given = {name: sample()[name] for name in model.card.modalities}
    seed = content_seed(0, *(each.numpy() for each in given.values()))
    with torch.no_grad():
        features = [
            sense.network.features(sense(recording), "fc2")[0].flatten(1)
            for sense, recording in zip(model.senses.values(), given.values(), strict=True)
        ]
        tuples = random_tuples([each.shape[1] for each in features], 200, seed)
        chosen = [each[:, tuples[:, place]] for place, each in enumerate(features)]
        expected = model.fusion.head(torch.cat(chosen).T).T
        torch.testing.assert_close(model.logits(**given), expected)


def test_the_label_depends_on_the_sample_alone():
    model = classifier("three")
    forwards = [model.classify(**sample(seed)) for seed in range(4)]
    backwards = [model.classify(**sample(seed)) for seed in reversed(range(4))][::-1]
    for left, right in zip(forwards, backwards, strict=True):
        assert left.label == right.label
        assert torch.equal(left.fragments, right.fragments)


def test_one_thread_computes_what_is_little(monkeypatch):
    model, used = classifier("haptic"), []
    model.network.trunk.register_forward_pre_hook(lambda *_: used.append(torch.get_num_threads()))
    weights = sum(values.numel() for values in model.network.parameters())
    monkeypatch.setattr("tex_lightning.classifier.classifier.ONE_THREAD", weights * 30_000)
    with computing_threads(2):
        model.classify(haptic=trace(2.9))
        model.classify(haptic=trace(2.9).expand(3, -1))  # joined before the network
        model.classify(haptic=trace(3.0))
    assert used == [1, 1, 2]


@pytest.mark.parametrize("level", ["fc2", "fc3"])
@pytest.mark.parametrize("kind", SENSES)
def test_a_checkpoint_rebuilds_it(tmp_path, kind, level):
    model = classifier(kind, level)
    for name, sense in model.senses.items():
        if hasattr(features := sense.features, "fit"):
            features.fit([features.magnitudes(sample()[name])])
    save_classifier(model, tmp_path / "m.ckpt")
    again = SurfaceClassifier.from_checkpoint(tmp_path / "m.ckpt", model.card.kind)
    torch.testing.assert_close(model.logits(**sample()), again.logits(**sample()), rtol=0, atol=0)
    assert again.card == model.card
    assert not again.training


def test_a_checkpoint_of_earlier_statistics_is_read(tmp_path):
    model = classifier("fusion")
    rows = torch.randn(12, len(model.embedding("haptic", trace())))
    model.statistics["haptic"] = FeatureStatistics.of(rows, torch.arange(12) % 3, 3)
    model.save(path := tmp_path / "m.ckpt")
    content = torch.load(path, weights_only=True)
    later = [key for key in content["state_dict"] if key.endswith((".scales", ".reach", ".error"))]
    for key in later:
        del content["state_dict"][key]
    torch.save(content, path)
    found = SurfaceClassifier.from_checkpoint(path)
    assert len(later) == 3
    assert not found.is_weighted("haptic")
    assert found.statistics["haptic"].scales.unique().tolist() == [1]


@pytest.fixture
def three() -> SurfaceClassifier:
    """A FusionNet of three senses with a bias that is not 0."""
    model = classifier("three")
    torch.nn.init.normal_(model.fusion.head.bias)
    return model.requires_grad_(False)


def own(model: SurfaceClassifier) -> dict[str, torch.Tensor]:
    """Of the sample, what the model looks at."""
    return {modality: sample()[modality] for modality in model.card.modalities}


@pytest.mark.parametrize("senses", [["haptic", "sound"], ["haptic", "visual", "sound"]])
def test_scores_of_single_senses_add_up_to_those_of_several(three, senses):
    parts = [three.with_senses([name]) for name in senses]
    scores = [part.logits(**own(part)) for part in parts]
    several = three.with_senses(senses)
    assert several.card.sense_names == tuple(senses)
    counts = [each.shape[1] for each in scores]
    tuples = random_tuples(counts, 200, several.seed(**own(several)))
    expected = sum(each[:, tuples[:, place]] for place, each in enumerate(scores))
    torch.testing.assert_close(several.logits(**own(several)), expected)


def test_a_sense_beyond_its_reach_counts_for_less_with_others_and_as_ever_alone(three):
    expected = {name: three.partial_logits(name, sample()[name]) for name in ("haptic", "sound")}
    alone = three.with_senses(["haptic"]).logits(**own(three.with_senses(["haptic"])))
    for name in expected:
        embedding = three.embedding(name, sample()[name])
        rows = torch.randn(12, len(embedding), generator=torch.Generator().manual_seed(0))
        known = FeatureStatistics.of(rows, torch.arange(12) % 3, 3)
        distance = known.nearest(embedding.mean(dim=1))[0]
        known.reach.copy_(distance * (0.5 if name == "haptic" else 2))
        three.statistics[name] = known
    found = {name: three.sense_output(name, sample()[name]).partial_logits for name in expected}
    for name, share in (("haptic", 0.25), ("sound", 1)):
        part, whole = found[name], expected[name]
        torch.testing.assert_close(part - part.mean(1, True), share * (whole - whole.mean(1, True)))
        probable = (part / share).mean(dim=1).softmax(dim=0)
        torch.testing.assert_close(probable, whole.mean(dim=1).softmax(dim=0))  # of no error
    part = three.with_senses(["haptic"])
    assert torch.equal(part.logits(**own(part)), alone)


def test_a_part_leaves_the_whole_as_it_is(three):
    before = {name: value.clone() for name, value in three.state_dict().items()}
    expected = three.logits(**sample())
    for senses in (["visual"], ["haptic", "sound"]):
        part = three.with_senses(senses)
        assert not [weight for weight in part.parameters() if weight.requires_grad]
        part.logits(**own(part))
    assert three.state_dict().keys() == before.keys()
    assert all(torch.equal(value, before[name]) for name, value in three.state_dict().items())
    assert torch.equal(three.logits(**sample()), expected)


@pytest.mark.parametrize("name", ["Headed", "Recurrent"])
def test_a_network_of_ones_own_with_a_head_is_fused_and_classifies_alone(name):
    trust("own_networks")
    torch.manual_seed(0)
    card = make_card("haptic", "visual", pairs=50, width=0.1)
    card.senses["haptic"]["network"] = {"_target_": f"own_networks.{name}"}
    model, recordings = SurfaceClassifier(card).eval(), sample()
    with torch.no_grad():
        alone = model.with_senses(["haptic"])
        scores = alone.logits(haptic=recordings["haptic"])
        torch.testing.assert_close(
            scores, model.partial_logits("haptic", recordings["haptic"]), rtol=1e-4, atol=1e-5
        )


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
@pytest.mark.parametrize("amplitude", [1, 30, 3000])
def test_features_are_computed_in_float32_within_mixed_precision(dtype, amplitude):
    model = classifier("three")
    recordings = sample() | {name: amplitude * sample()[name] for name in ("haptic", "sound")}
    for sense in model.senses.values():
        recording = recordings[sense.modality]
        expected = sense(recording)
        with torch.autocast("cpu", dtype=dtype):
            found = sense(recording)
        assert found.dtype == torch.float32
        torch.testing.assert_close(found, expected, rtol=0, atol=0)


def test_foreign_damaged_and_mistaken_checkpoints_are_refused(tmp_path):
    path = tmp_path / "m.ckpt"
    model = classifier("haptic")
    for changes in ({"state_dict": {}}, {"hyper_parameters": {"lr": 1}}, {"hyper_parameters": 3}):
        save_classifier(model, path, **changes)
        with pytest.raises(
            UserError, match=r"damaged or was not written|more weights than the file"
        ):
            SurfaceClassifier.from_checkpoint(path)
    save_classifier(model, path)
    with pytest.raises(UserError, match="holds a haptic network where a visual network"):
        SurfaceClassifier.from_checkpoint(path, "visual")
    with pytest.raises(UserError, match="does not exist"):
        SurfaceClassifier.from_checkpoint(tmp_path / "none.ckpt")


def test_too_short_too_small_and_missing_are_said():
    with pytest.raises(UserError, match=r"2\.26 s|1\.81 s for one fragment"):
        classifier("haptic").logits(haptic=trace(1.8))
    assert classifier("haptic").logits(haptic=trace(1.81)).shape == (3, 1)
    with pytest.raises(UserError, match=r"198x198 pixels .* needs 199 on each side"):
        classifier("visual").logits(image=photo(198))
    with pytest.raises(UserError, match="give image=FILE too"):
        classifier("fusion").logits(haptic=trace())
