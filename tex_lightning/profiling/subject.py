"""What a profile is of."""

from dataclasses import dataclass

from torch import Tensor, nn

from tex_lightning.branches import Branch
from tex_lightning.classifier import SurfaceClassifier


@dataclass(frozen=True)
class Subject:
    """A unimodal classifier and what it is to classify.

    Attributes:
        classifier: In evaluation mode, as trained.
        recording: Decoded, as its branch takes it.
    """

    classifier: SurfaceClassifier
    recording: Tensor

    @property
    def branch(self) -> Branch:
        """The only branch of the classifier."""
        return only_branch(self.classifier)

    def features(self, classifier: SurfaceClassifier) -> Tensor:
        """Network input (1, C, H, W) of the recording, as this or an equal classifier has it."""
        branch = only_branch(classifier)
        return like_weights(branch.network, branch(self.recording))


def only_branch(classifier: SurfaceClassifier) -> Branch:
    """The branch of a unimodal classifier."""
    (branch,) = classifier.branches.values()
    return branch


def like_weights(network: nn.Module, x: Tensor) -> Tensor:
    """An input in the precision and on the device of a network's first weights."""
    return x.to(next(network.parameters(), x))
