"""scikit-learn estimators as tensors of bytes, so that a checkpoint holds nothing but tensors.

skops stores what an estimator is made of and, unlike pickle, runs nothing when it is read: types
outside scikit-learn, NumPy and SciPy are refused unless they are named here.
"""

from io import BytesIO
from typing import Any

import numpy as np
import skops.io
import torch
from torch import Tensor

from tex_lightning.networks.archives import check_archive

TRUSTED = ("aeon.", "tex_lightning.baselines.", "sklearn.", "numpy.", "scipy.")


def dump_estimator(estimator: Any) -> Tensor:  # noqa: ANN401
    """An estimator as a uint8 tensor (bytes,)."""
    return torch.from_numpy(np.frombuffer(skops.io.dumps(estimator), dtype=np.uint8).copy())


def load_estimator(stored: Tensor) -> Any:  # noqa: ANN401
    """Read an estimator back.

    Raises:
        ValueError: If the bytes name types from elsewhere.
    """
    content = stored.numpy().tobytes()
    check_archive(BytesIO(content))
    foreign = skops.io.get_untrusted_types(data=content)
    refused = [name for name in foreign if not name.startswith(TRUSTED)]
    if refused:
        raise ValueError(f"the estimator holds foreign types: {', '.join(refused)}")
    return skops.io.loads(content, trusted=foreign)
