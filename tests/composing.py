"""Hydra's composition of the same files, once a process.

Most tests compose the package's configuration, and a composition reads forty files again. What
depends on the files and the chosen options alone is kept: the content of a file, the list of
defaults, and what they merge to. Values that are given are put in each time, and whatever a user's
folders take part in is composed anew.
"""

import copy
import pickle
from collections.abc import Sequence
from typing import Any

import pytest
from hydra._internal import config_loader_impl
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import ConfigRepository, IConfigRepository
from hydra._internal.defaults_list import DefaultsList
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.types import Override
from hydra.plugins.config_source import ConfigResult
from omegaconf import DictConfig

from tex_lightning.config import CONF

OWN = {"hydra.conf", str(CONF), ""}  # paths of Hydra, the package and its schema


def compose_once(patch: pytest.MonkeyPatch) -> None:
    """Keep what Hydra composes of the package's files."""
    lists: dict[object, DefaultsList] = {}
    merged: dict[object, bytes] = {}  # copied by pickle, in a fifth of the time of deepcopy
    list_defaults = config_loader_impl.create_defaults_list
    merge = ConfigLoaderImpl._compose_config_from_defaults_list
    load, files = ConfigRepository.load_config, dict[str, bytes]()

    def once_loaded(self: ConfigRepository, config_path: str) -> ConfigResult | None:
        if not _is_own(self):
            return load(self, config_path)
        if config_path not in files:
            files[config_path] = pickle.dumps(load(self, config_path))
        found: ConfigResult | None = pickle.loads(files[config_path])
        return found

    def once_listed(
        repo: IConfigRepository, config_name: str, overrides_list: list[Override], **how: Any
    ) -> DefaultsList:
        if not _is_own(repo):
            return list_defaults(repo, config_name, overrides_list, **how)
        given = [each for each in overrides_list if not each.is_sweep_override()]
        options = [
            each for each in given
            if repo.group_exists(each.key_or_group) and not isinstance(each.value(), dict)
        ]  # fmt: skip
        key = config_name, *(each.input_line for each in options), *how.items()
        if key not in lists:
            lists[key] = list_defaults(repo, config_name, options, **how)
        found = copy.copy(lists[key])
        found.config_overrides = [each for each in given if each not in options]
        return found

    def once_merged(
        self: ConfigLoaderImpl, defaults: Sequence[Any], repo: IConfigRepository
    ) -> DictConfig:
        if not _is_own(repo):
            return merge(self, defaults, repo)
        key = repr(defaults)
        if key not in merged:
            merged[key] = pickle.dumps(merge(self, defaults, repo))
        found: DictConfig = pickle.loads(merged[key])
        return found

    # with each composition Hydra copies the registered schemas, which it does not change
    patch.setattr(ConfigStore, "__deepcopy__", lambda store, _: store, raising=False)
    patch.setattr(ConfigRepository, "load_config", once_loaded)
    patch.setattr(config_loader_impl, "create_defaults_list", once_listed)
    patch.setattr(ConfigLoaderImpl, "_compose_config_from_defaults_list", once_merged)


def _is_own(repo: IConfigRepository) -> bool:
    return {source.path for source in repo.get_sources()} <= OWN
