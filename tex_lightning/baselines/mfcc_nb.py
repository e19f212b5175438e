"""Modified cepstral coefficients, averaged over the movement, and Gaussian naive Bayes.

After Strese, Schuwerk and Steinbach (World Haptics 2015). What they call decreasing is not
defined there; here it is a setting.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from sklearn.naive_bayes import GaussianNB

from tex_lightning.baselines.base import Array, EstimatorBaseline
from tex_lightning.baselines.mfcc import Cepstra


@dataclass
class MfccNaiveBayes(EstimatorBaseline, Cepstra):
    """One mean and one variance for each class and coefficient; a whole trace is one fragment."""

    kind: ClassVar = "haptic"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check()

    def features(self, recording: Array) -> Array:
        """Mean of the frames' coefficients (last - first + 1,)."""
        mean: Array = self.coefficients(recording, self.sampling_rate).mean(axis=0)
        return mean

    def make_estimator(self, seed: int) -> Any:  # noqa: ANN401  (nothing is random)
        """Naive Bayes with normal densities."""
        return GaussianNB()
