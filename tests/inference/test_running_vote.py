"""A stream that goes on from its last vote says what the whole recording says."""

from functools import reduce

import numpy as np
import pytest
import torch
from conftest import RATE, make_card, make_trace
from hypothesis import given, settings
from hypothesis import strategies as st

import tex_lightning as tl
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import RULES, Tally
from tex_lightning.config import StreamConfig
from tex_lightning.errors import UserError
from tex_lightning.inference.stream import LiveStream, ResampledSignal
from tex_lightning_runtime.quality import Level, Survey, level, limits, trace_quality


def hapticnet(**features) -> SurfaceClassifier:
    torch.manual_seed(0)
    card = make_card("haptic", classes=["a", "b", "c"], width=0.1, **features)
    card.input_ranges["haptic"] = {"level": [1.0, 5.0], "rate": [RATE, RATE]}
    classifier = SurfaceClassifier(card).eval()
    with torch.inference_mode():  # each class gets some fragments: else nothing could differ
        scores = classifier.sense_output("haptic", torch.from_numpy(strokes(RATE))).partial_logits
        classifier.senses["haptic"].network.head.scores[1].bias -= scores.median(dim=1).values
    return classifier


def live(classifier, rate=None) -> LiveStream:
    config = StreamConfig(chunk=0.1, window=None, axes=1)
    return LiveStream(classifier, {"haptic": rate}, {}, config, top_k=3)


def strokes(rate: float, axes: int = 1, *lengths: float) -> np.ndarray:
    """Noise that drifts, with a quiet beginning and pauses, and louder in the end."""
    rng = np.random.default_rng(axes)
    loud = [1e-3, 1.0, 1e-3, 3.0, 1e-3]
    parts = [
        strength * rng.standard_normal((axes, int(seconds * rate)))
        for strength, seconds in zip(loud, lengths or (0.5, 5.0, 2.0, 3.0, 1.5), strict=True)
    ]
    joined = np.concatenate(parts, axis=1)
    return (9.8 + joined * (1.5 + np.sin(np.arange(joined.shape[1]) / rate))).astype(np.float32)


def said_by_the_whole(stream, samples):
    """What a signal so far is called, and what its samples lack; None without a fragment."""
    (signal,), classifier = stream.signals.values(), stream.classifier
    ranges = stream.card.input_ranges["haptic"]
    recording, quality = signal.sense.resample(samples.astype(float), signal.rate, ranges, "it")
    try:
        return classifier.classify(haptic=recording), quality
    except UserError:
        return None, quality


@pytest.mark.parametrize(("axes", "rate"), [(1, None), (3, None), (1, 3200.0), (2, 44_100.0)])
def test_a_network_says_of_every_increment_what_it_says_of_the_whole(axes, rate):
    stream, samples = live(hapticnet(), rate), strokes(rate or RATE, axes)
    rng, end, seen = np.random.default_rng(0), 0, []
    while end < samples.shape[1]:
        begin, end = end, end + int(rng.integers(1, rate or RATE))
        found, (vote, quality) = (
            stream.push(samples[:, begin:end]),
            said_by_the_whole(stream, samples[:, :end]),
        )
        assert found.warnings == quality.warnings
        assert (found.label is None) == (vote is None)
        if vote is not None:
            seen.append(vote)
            assert found.label == stream.card.classes[vote.label]
            assert found.fragments == len(vote.fragments)
            expected = vote.doubted(quality.doubt).probability
            assert found.probability == pytest.approx(expected, abs=1e-4)
    assert len(seen) > 5
    assert len({*seen[-1].fragments.tolist()}) > 1


def test_a_rest_in_the_end_does_not_count_however_long():
    stream, samples = live(hapticnet()), strokes(RATE, 1, 0.5, 5.0, 0.0, 1.0, 6.0)
    *_, last = (stream.push(part) for part in np.array_split(samples, 50, axis=1))
    vote, quality = said_by_the_whole(stream, samples)
    assert last.fragments == len(vote.fragments)
    assert last.probability == pytest.approx(vote.doubted(quality.doubt).probability, abs=1e-4)


def of_another_gain() -> SurfaceClassifier:
    """A classifier that was trained on weaker strokes, whose beginnings differ."""
    classifier = hapticnet()
    features = classifier.senses["haptic"].features
    weaker = [torch.from_numpy(strokes(RATE, axes)[:1] / 40) for axes in (1, 2)]
    features.fit([features.magnitudes(trace) for trace in weaker])
    return classifier


LONG_REST = (6.0, 0.0, 0.0, 6.0, 0.5)


@pytest.mark.parametrize(
    "seconds", [(0.5, 8.0, 0.0, 1.0, 0.5), (0.5, 2.5, 2.5, 3.0, 1.0), LONG_REST, (4.0, 1, 0, 1, 9)]
)
def test_the_gain_of_the_first_seconds_of_movement_is_that_of_the_whole(seconds):
    classifier, samples = of_another_gain(), strokes(RATE, 1, *seconds)
    stream, step = live(classifier), RATE // 2
    for end in range(step, samples.shape[1], step):
        found = stream.push(samples[:, end - step : end])
        vote, quality = said_by_the_whole(stream, samples[:, :end])
        if vote is not None:
            expected = vote.doubted(quality.doubt).probability
            assert found.probability == pytest.approx(expected, abs=1e-4)
            assert found.fragments == len(vote.fragments)
    if seconds[-1] < 9:
        *_, (_, (gain, _)) = stream.running_vote.corrections
        strength = 3 if seconds == LONG_REST else 1
        assert gain.numpy() == pytest.approx(1 / 40 / strength, rel=0.2)


SLOW = pytest.mark.slow


@pytest.mark.parametrize("kind", [0, pytest.param(1, marks=SLOW), pytest.param(2, marks=SLOW)])
def test_band_proportions_have_the_label_of_the_whole_at_every_increment(bands, kind):
    model = tl.load(bands)
    pause = 1e-4 * np.random.default_rng(0).standard_normal((3, RATE))
    parts = [pause.ravel()]  # longer than what is classified from scratch
    for number in range(4):
        parts += [make_trace(kind, number), pause[0] if number == 1 else pause[0, :0]]
    samples, stream = np.concatenate(parts), model.stream()
    for end in range(0, len(samples), 2500):
        found = stream.push(samples[end : end + 2500])
        if end >= 3.25 * RATE:  # the tool moves for half a second
            whole = model.predict(haptic=samples[: end + 2500])
            assert found.label == whole.label
            assert found.probability == pytest.approx(whole.probability, abs=0.1)
            assert abs(found.fragments - whole.fragments) <= 2


def test_a_slow_signal_has_the_label_of_the_whole_recording():
    rng = np.random.default_rng(0)

    def recording(kind, seconds):
        time = np.arange(round(seconds * 50)) / 50
        tone = np.sin(2 * np.pi * (3 + 4 * kind) * time + rng.uniform(0, 6))
        return np.stack([tone, 9.8 + kind + 0 * tone]) + 0.3 * rng.standard_normal((2, len(time)))

    labels = np.repeat([0, 1, 2], 4)
    model = tl.Estimator("few/haptic", rate=50, verbose=0)
    model.fit([recording(kind, 8) for kind in labels], labels)
    for kind in range(3):
        samples, stream = recording(kind, 30), model.predictor_.stream()
        samples[:, 1000:1200] = samples[:, 1000:1001]  # 4 s of rest
        *_, last = (stream.push(samples[:, i : i + 25]) for i in range(0, samples.shape[1], 25))
        whole = model.predictor_.predict(haptic=samples)
        assert last.label == whole.label == str(kind)
        assert last.fragments == whole.fragments


def test_a_stream_and_a_recording_of_an_accelerometer_in_another_unit_have_the_same_label():
    rng = np.random.default_rng(0)

    def recording(kind, seconds, unit=9.81):
        time = np.arange(round(seconds * 50)) / 50
        tone = (0.1 + 0.1 * kind) * np.sin(2 * np.pi * 6 * time + rng.uniform(0, 6))
        axes = np.stack([tone, 0.1 + 0 * tone, 1 + 0 * tone])
        return unit * (axes + 0.02 * rng.standard_normal(axes.shape))

    labels = np.repeat([0, 1, 2], 4)
    model = tl.Estimator("few/haptic", rate=50, verbose=0)
    model.fit([recording(kind, 8) for kind in labels], labels)
    for kind, unit in enumerate([1.0, 1000.0, 4.9]):
        samples, stream = recording(kind, 30, unit), model.predictor_.stream()
        *_, last = (stream.push(samples[:, i : i + 25]) for i in range(0, samples.shape[1], 25))
        whole = model.predictor_.predict(haptic=samples)
        assert last.label == whole.label == str(kind)
        assert last.confidence == pytest.approx(whole.confidence, abs=0.02)
        assert whole.confidence > 0.5


def held(stream: LiveStream) -> int:
    """Bytes of the samples, frames and sums that a stream holds, but for its classifier."""
    (signal,), parts = stream.signals.values(), vars(stream.running_vote).values()
    rests = vars(stream.running_vote.rests).values()
    arrays = [x for x in (*parts, *rests) if isinstance(x, torch.Tensor)]
    sums = [x.total for x in stream.running_vote.sums.values()]
    return signal.kept.nbytes + sum(x.nbytes for x in (*arrays, *sums))


@pytest.mark.parametrize("model", ["network", pytest.param("bands", marks=SLOW)])
def test_memory_does_not_grow_with_the_signal(model, bands):
    stream = tl.load(bands).stream() if model == "bands" else live(hapticnet(), 3000.0)
    rng, sizes = np.random.default_rng(0), []
    for _ in range(60):
        stream.push(rng.standard_normal(RATE // 2))
        sizes.append(held(stream))
    assert max(sizes[40:]) <= 1.5 * max(sizes[15:35])
    assert max(sizes) < 2_000_000


@settings(max_examples=20)
@given(cuts=st.lists(st.integers(1, 999), max_size=5), top=st.sampled_from([0.0, 0.7, 3.0, 9.0]))
def test_faults_are_those_of_the_whole(cuts, top):
    whole = np.random.default_rng(len(cuts)).standard_normal((2, 1000)).clip(-top, top)
    if top == 3.0:
        whole = whole.round()  # hardly any different values
    survey, running = Survey(), Level()
    for part in np.split(whole, sorted({*cuts}), axis=1):
        survey.add(part)
        running = running.plus(part)
    usual = limits({"level": [9.0, 9.9]})
    measures = {"level": level(whole), "rate": 50.0}
    assert running.value == pytest.approx(level(whole))
    expected = trace_quality(whole, usual, "trace", measures)
    assert survey.quality(usual, "trace", measures) == expected


@pytest.mark.parametrize("rate", [10_000.0, 9_000.0, 44_100.0, 3_333.0])
def test_resampled_pieces_are_those_of_the_whole(rate):
    signal = ResampledSignal(hapticnet().senses["haptic"], rate, {})
    samples = np.random.default_rng(0).standard_normal((2, 30_000))
    samples[:, [3, 40, 55, 8_998, 9_000, 9_020, 19_992, 25_000, 29_990]] += 40  # spikes
    parts = [signal.take(part) for part in np.split(samples, [1, 50, 9000, 9001, 20_000], axis=1)]
    pieces = torch.cat([*(new for new, _, _ in parts), parts[-1][1]], dim=1)
    whole, _ = signal.sense.resample(samples, rate, {}, "it")
    assert torch.equal(pieces, whole)
    assert signal.kept.shape[1] < 15_000


@pytest.mark.parametrize("rule", RULES)
def test_a_tally_votes_as_its_fragments_do(rule):
    scores = torch.randn(4, 30, generator=torch.Generator().manual_seed(0))
    whole = RULES[rule](scores, 2.0)
    tally = reduce(Tally.__add__, (Tally.of(part, 2.0) for part in scores.split(7, dim=1)))
    found = RULES[rule].of_tally(tally)
    assert (found.label, found.by_mean) == (whole.label, whole.by_mean)
    assert found.fragments.bincount(minlength=4).equal(whole.fragments.bincount(minlength=4))
    torch.testing.assert_close(found.shares, whole.shares)
    torch.testing.assert_close(found.probabilities, whole.probabilities)
