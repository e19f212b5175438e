"""What is asked of the flags of Lightning's Trainer."""

import difflib
import inspect
from collections.abc import Iterator
from typing import Any

OWN = {
    "callbacks": "callbacks=[default,NAME]",
    "default_root_dir": "hydra.run.dir",
    "fast_dev_run": "debug=tiny",
    "logger": "logger=NAME",
    "max_epochs": "fit.epochs of the network",
    "plugins": "strategy",
    "use_distributed_sampler": "nothing: every process knows its share",
}


def check_flags(flags: dict[str, Any]) -> Iterator[str]:
    """Flags that Lightning does not have, or that this package sets by itself."""
    from lightning import Trainer  # takes seconds, and only a run needs it

    known = [name for name in inspect.signature(Trainer.__init__).parameters if name != "self"]
    for name in flags:
        if name in OWN:
            yield f"trainer.{name} is set by this package: use {OWN[name]}"
        elif name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f" (did you mean trainer.{near[0]}?)" if near else ""
            yield f"trainer.{name} is no flag of Lightning's Trainer{hint}: leave it out"
