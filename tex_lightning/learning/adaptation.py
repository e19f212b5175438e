"""Fit a network in closed form again, with unlabelled recordings that it is to classify.

Self-training (Scudder 1965): the network is fitted to its training rows and to the recordings whose
label it is surest of, twice, with more of them each time. That also teaches what is wrong where
classes are absent, unknown or rare, so that there are guards. Classes that hardly any recording is
taken for are not taught. And recordings that are left out of the fit have to be told apart more
clearly, with the same labels (Lange et al. 2004, Stability-based validation of clustering
solutions), or all stays as it was. No label is ever needed.
"""

from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from statistics import median
from typing import Any, NamedTuple, cast

import torch
from torch import Tensor, nn

from tex_lightning.classifier.card import CROSSVAL, NOVELTIES
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics, TrainingRows
from tex_lightning.errors import UserError
from tex_lightning.learning.finish import statistics_with_reach
from tex_lightning.networks.linear import SHORT_PART, LinearNet

SHARES = (0.25, 0.5)  # of the recordings of a class, the surest, that are taught in each round
LEAST = 3  # recordings of a class that is taught
COMMON = 0.5  # of the usual number of recordings of a class: with more it is there
SURE = 0.5  # of the usual margin, which a quarter of the recordings of a rarer one exceed
MANY = 1 / 3  # of the classes, which have to be there before rarer ones count
MOST = 0.75  # of the classes, which have to be there if each has one training recording
COVERED = 0.75  # share of the recordings whose classes have to be there
BETWEEN = 0.25  # of the usual margin: a recording with less lies between classes
FEWER = 0.75  # of the recordings that lay between classes may do so afterwards
APART = 4.0  # deviations between two classes; one cluster cut in two has at most 12**0.5
BLURRED = 0.1  # of the recordings may be of classes that are closer to another one
STABLE = 0.96  # of the labels, which a fit without the recording itself gives, too
PARTS = 3  # of the recordings, each of which is left out of a fit once


class Adaptation(NamedTuple):
    """The result of an adaptation.

    Attributes:
        classifier: The new one, on the CPU; the given one if nothing was done.
        reason: Why nothing was done; empty if something was.
        recordings: Number of recordings that were given and not called unknown.
        taught: Number of recordings that taught each class.
        changed: Number of recordings that have another label than before.
    """

    classifier: SurfaceClassifier
    reason: str
    recordings: int
    taught: dict[str, int]
    changed: int

    def __str__(self) -> str:
        """Say what was done, or why nothing was."""
        if self.reason:
            return f"Nothing was adapted: {self.reason}."
        return (
            f"Adapted to {self.recordings} recordings, of which {sum(self.taught.values())} taught "
            f"{len(self.taught)} classes; {self.changed} have another label than before."
        )


def adapt(
    classifier: SurfaceClassifier, embeddings: Iterable[Tensor], unknown_above: float | None = None
) -> Adaptation:
    """Fit a copy of a classifier again with unlabelled recordings, where that seems safe.

    The order of the recordings makes no difference.

    Args:
        classifier: Of one network in closed form that keeps its training rows.
        embeddings: What :meth:`~SurfaceClassifier.embedding` gives for each recording, (D,
            positions).
        unknown_above: Novelty of recordings that are not learnt from, the card's ``unknown_above``:
            a class that was never seen would teach another one, and be taken for that. None
            learns from all.

    Raises:
        UserError: If the classifier cannot be adapted.
    """
    check_adaptable(classifier)
    recordings = [(x.mean(dim=1).cpu(), x.shape[1]) for x in embeddings]
    whole = deepcopy(classifier).cpu()
    (name,) = whole.senses
    if unknown_above is not None:
        novelty = cast(FeatureStatistics, whole.statistics[name]).novelty
        recordings = [(mean, count) for mean, count in recordings if novelty(mean) <= unknown_above]
    recordings.sort(key=lambda pair: pair[0].numpy().tobytes())
    if not recordings:
        return Adaptation(classifier, "there are no recordings of known classes", 0, {}, 0)
    means = torch.stack([mean for mean, _ in recordings])
    student = _Student(cast(LinearNet, whole.network), cast(TrainingRows, whole.rows[name]), means)
    try:
        network, labels, changed = student.learn()
    except Unsafe as error:
        return Adaptation(classifier, str(error), len(recordings), {}, 0)
    usual = median(count for _, count in recordings)
    network.scores.gate.fragments.fill_(usual)
    network.scores.range.most.fill_(int(usual * SHORT_PART))
    _replace(whole, name, student, network, labels)
    counts = labels[labels >= 0].bincount(minlength=network.classes).tolist()
    by_class = {x: n for x, n in zip(classifier.card.classes, counts, strict=True) if n}
    return Adaptation(whole.eval(), "", len(recordings), by_class, changed)


@torch.inference_mode()
def sample_features(
    classifier: SurfaceClassifier, samples: Iterable[Mapping[str, tuple[Tensor, object]]]
) -> Iterator[Tensor]:
    """Yield features (D, positions) of decoded samples by the only sense of a classifier."""
    ((name, sense),) = classifier.senses.items()
    for decoded in samples:
        yield classifier.embedding(name, decoded[sense.modality][0])


def check_adaptable(classifier: SurfaceClassifier) -> None:
    """Reject a classifier that cannot be fitted again.

    Raises:
        UserError: Saying why.
    """
    title, ours = classifier.card.title, "task=adapt fits band proportions (experiment=few/haptic)"
    if classifier.card.baseline or classifier.fusion is not None:
        raise UserError(f"This is a {title}, and {ours} again; give a checkpoint of these.")
    network = classifier.network
    if not isinstance(network, LinearNet):
        raise UserError(f"This {title} is not fitted in closed form, and {ours} again; train one.")
    if not classifier.rows:
        raise UserError(
            f"This {title} keeps no features of its training recordings, which {ours} again with; "
            "train it anew with keep_rows=true."
        )
    if network.scores.planes.in_use:
        raise UserError(
            f"The classes of this {title} are planes, which need the fragments of all training "
            "recordings; train it anew on recordings of the new conditions."
        )


class Unsafe(Exception):
    """Why a network should stay as it is, in a phrase."""


class _Student:
    """A network with its training rows, and the recordings that may teach it.

    Args:
        network: Fitted; a copy, which is changed.
        rows: Its training rows.
        embeddings: Mean features (recordings, D) of the others.
    """

    def __init__(self, network: LinearNet, rows: TrainingRows, embeddings: Tensor) -> None:
        self.network, self.labels = network, rows.labels
        self.groups = rows.groups.tolist()
        known = {*zip(self.labels.tolist(), self.groups, strict=True)}
        counts = torch.tensor([label for label, _ in known]).bincount(minlength=network.classes)
        self.single = bool(counts.median() < 2)  # recordings, or what was recorded together
        self.known = _inputs(network, rows.features)
        self.others = _inputs(network, embeddings)
        scores = network.scores  # whole recordings are looked at, as one fragment each
        scores.gate.fragments.fill_(1)
        scores.range.most.zero_()
        scores.short.take(None)
        scores.reach.train()  # margins are those of the line

    def learn(self) -> tuple[LinearNet, Tensor, int]:
        """Fit the network again.

        Returns:
            The network; the class index of each recording that it was fitted to, -1 of others
            (recordings,); how many recordings have another label than before.

        Raises:
            Unsafe: If that should not be used.
        """
        scores = before = self.scores(self.network)
        present, labels = _present(before), before.argmax(dim=1)
        covered = int(present[labels].sum())
        if covered < COVERED * len(labels):
            raise Unsafe(
                f"of {len(labels)} recordings only {covered} are of classes that are clearly "
                "among them; give more recordings of each class"
            )
        there, classes = int(present.sum()), len(present)
        if self.single and there < MOST * classes:
            raise Unsafe(
                f"only {there} of {classes} classes are clearly among the recordings, and one "
                "training recording of each does not tell which are absent"
            )
        network, taught = self.network, present[labels]
        for share in SHARES:
            labels = scores.argmax(dim=1)
            taught = _surest(scores, share) & present[labels]
            network = self.fitted(taught, labels)
            scores = self.scores(network)
        check_told_apart(before, scores, self.left_out(taught, labels))
        changed = int((scores.argmax(dim=1) != before.argmax(dim=1)).sum())
        return network, labels.where(taught, -1), changed

    def fitted(self, taught: Tensor, labels: Tensor) -> LinearNet:
        """Return a network fitted to the training rows and the marked recordings."""
        network, count = deepcopy(self.network), int(taught.sum())
        rows = torch.cat([self.known, self.others[taught]])
        groups = [*map(str, self.groups), *(f"other {number}" for number in range(count))]
        network.fit([*rows[:, None]], torch.cat([self.labels, labels[taught]]), groups)
        return network

    @torch.no_grad()
    def scores(self, network: LinearNet) -> Tensor:
        """Return the scores (recordings, classes) that a network gives."""
        scores: Tensor = network(self.others[:, None])
        return scores[..., 0]

    def left_out(self, taught: Tensor, labels: Tensor) -> Tensor:
        """Return the scores (recordings, classes) of each recording by a fit without its part."""
        order = labels.argsort(stable=True)  # each class is spread over the parts
        part = torch.empty_like(order)
        part[order] = torch.arange(len(order)) % PARTS
        scores = torch.zeros(len(labels), self.network.classes)
        for number in range(PARTS):
            out = part == number
            scores[out] = self.scores(self.fitted(taught & ~out, labels))[out]
        return scores


def _inputs(network: LinearNet, embeddings: Tensor) -> Tensor:
    """Return the features (recordings, D, 1) whose embeddings (recordings, D) are given.

    What the network takes for constant is its mean.
    """
    features = embeddings.double()
    if network.level_features:
        rest, levels = features.tensor_split([-network.level_features], dim=1)
        levels = levels @ torch.linalg.inv(network.whitening.double())
        features = torch.cat([rest, levels], dim=1)
    scale = network.scale.double()[:, 0, 0]
    inverse = torch.where(scale > 0, 1 / scale, 0)
    return (features * inverse + network.mean.double()[:, 0, 0]).float()[:, :, None]


def _margins(scores: Tensor) -> Tensor:
    """Return by how much the best score of each row leads (rows,)."""
    best = scores.topk(2, dim=1).values
    return best[:, 0] - best[:, 1]


def _between(scores: Tensor) -> int:
    """Count the recordings that lie between classes."""
    margins = _margins(scores)
    return int((margins < BETWEEN * margins.median()).sum())


def check_told_apart(before: Tensor, after: Tensor, left_out: Tensor) -> None:
    """Reject scores (recordings, classes) that are not to be trusted.

    Args:
        before: Of the network as it was.
        after: Of that which all recordings could teach.
        left_out: Of those that the recording itself could not teach.

    Raises:
        Unsafe: Saying why.
    """
    count, was, now = len(before), _between(before), _between(left_out)
    if not (now < was and now <= FEWER * was):
        raise Unsafe(
            "the classes would not be told apart more clearly; "
            f"of {count} recordings {was} lie between classes, and {now} would"
        )
    blurred = _blurred(left_out)
    if blurred > BLURRED * count:
        raise Unsafe(
            "some classes may be parts of others; "
            f"{blurred} of {count} recordings are of classes without a gap to another one"
        )
    same = int((after.argmax(dim=1) == left_out.argmax(dim=1)).sum())
    if same < STABLE * count:
        raise Unsafe(
            "the labels depend too much on which recordings are given; "
            f"with some of them left out only {same} of {count} have the same label"
        )


def _blurred(scores: Tensor) -> int:
    """Count the recordings of classes that have no gap to a larger one.

    It is the separation of Ashman et al. (1994, Detecting bimodality in astronomical datasets).
    """
    labels = scores.argmax(dim=1)
    members = nn.functional.one_hot(labels, scores.shape[1]).T.to(scores)
    counts = members.sum(dim=1)
    leads = scores.gather(1, labels[:, None]) - scores  # over each other class
    means = members @ leads / counts[:, None]
    variances = members @ (leads - means[labels]).square() / (counts[:, None] - 1)
    close = means + means.T < APART * ((variances + variances.T) / 2).sqrt()
    ascending = counts.argsort(stable=True)
    ascending = ascending[counts[ascending] >= LEAST]
    blurred = close[ascending][:, ascending].triu(1).any(dim=1)
    return int(counts[ascending][blurred].sum())


def _surest(scores: Tensor, share: float) -> Tensor:
    """Mark (recordings,) the share of each label's recordings whose margin is the largest."""
    labels, margins = scores.argmax(dim=1), _margins(scores)
    marked = torch.zeros_like(labels, dtype=torch.bool)
    for label in {*labels.tolist()}:
        members = (labels == label).nonzero()[:, 0]
        surest = members[margins[members].argsort(descending=True, stable=True)]
        marked[surest[: -int(-len(members) * share // 1)]] = True
    return marked


def _present(scores: Tensor) -> Tensor:
    """Return which classes are clearly among the recordings (classes,).

    What is mistaken for a class that is absent is little. Only where many classes are there, the
    others are likely to be there, too, and few recordings do that are sure. The usual class is that
    of the median recording, so that one common class does not hide all others.
    """
    labels, margins = scores.argmax(dim=1), _margins(scores)
    counts = labels.bincount(minlength=scores.shape[1])
    ascending = counts.sort().values
    usual = ascending[2 * ascending.cumsum(dim=0) >= len(labels)][0]
    enough = counts >= LEAST
    present = enough & (counts >= COMMON * usual)
    if present.sum() >= MANY * len(present):
        for label in (enough & ~present).nonzero()[:, 0].tolist():
            upper = margins[labels == label].quantile(0.75)
            present[label] = upper >= SURE * margins.median()
    return present


def _replace(
    classifier: SurfaceClassifier, name: str, student: _Student, network: LinearNet, labels: Tensor
) -> None:
    """Put a refitted network into a classifier, with what its checkpoint keeps.

    The rows stay those of the training, whose labels are known.
    """
    taught = labels >= 0
    with torch.no_grad():
        known, others = (
            network.features(x[:, None], "fc2")[..., 0]
            for x in (student.known, student.others[taught])
        )
    statistics, left_out = statistics_with_reach(
        torch.cat([known, others]),
        torch.cat([student.labels, labels[taught]]),
        network.classes,
        [*student.groups, *(f"other {number}" for number in range(len(others)))],
    )
    sense: Any = classifier.senses[name]
    sense.network = network
    classifier.statistics[name] = statistics
    classifier.rows = nn.ModuleDict({name: TrainingRows.of(known, student.labels, student.groups)})
    card = classifier.card
    novelties = {NOVELTIES: {name: [x for x in left_out if x is not None]}} if left_out else {}
    kept = {key: value for key, value in card.training.items() if key != CROSSVAL}
    classifier.card = replace(
        card,
        calibration={**card.calibration, **novelties},
        training={**kept, "val_loss": None, "left_out": {name: left_out}},
    )
