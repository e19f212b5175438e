"""Hydra's composition of the same files, once a process.

Most tests compose the package's configuration, and a composition reads and merges forty files. What
depends on the files and the chosen options alone is kept: the content of a file, the list of
defaults, and what the first of them merge to. Values that are given are put in each time, and
whatever a user's folders take part in is composed anew.
"""

import copy
import functools
import pickle
from collections.abc import Sequence
from typing import Any

import pytest
from hydra._internal import config_loader_impl, defaults_list
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import ConfigRepository, IConfigRepository
from hydra._internal.defaults_list import DefaultsList
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.types import Override
from hydra.plugins.config_source import ConfigResult
from omegaconf import DictConfig, OmegaConf
from omegaconf.grammar_parser import parse

from tex_lightning.config import CONF

BLOCK = 4  # files after which what they merge to is kept
OWN = {"hydra.conf", str(CONF), ""}  # paths of Hydra, the package and its schema


def compose_once(patch: pytest.MonkeyPatch) -> None:
    """Keep what Hydra composes of the package's files."""
    lists: dict[object, DefaultsList] = {}
    merged: dict[str, bytes] = {}
    list_defaults = config_loader_impl.create_defaults_list
    merge = ConfigLoaderImpl._compose_config_from_defaults_list
    load, files = ConfigRepository.load_config, dict[str, ConfigResult | None]()
    choices, create = defaults_list._create_interpolation_map, OmegaConf.create

    def once_loaded(self: ConfigRepository, config_path: str) -> ConfigResult | None:
        if not _is_own(self):
            return load(self, config_path)
        if config_path not in files:
            files[config_path] = load(self, config_path)
        return files[config_path]

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
        found: DictConfig = pickle.loads(merged_to(self, defaults, repo))
        return found

    def merged_to(
        self: ConfigLoaderImpl, defaults: Sequence[Any], repo: IConfigRepository
    ) -> bytes:
        """Go on from what the most files in this order have merged to."""
        key = repr(defaults)
        if key not in merged:
            before = defaults[: (len(defaults) - 1) // BLOCK * BLOCK]
            begun = [pickle.loads(merged_to(self, before, repo))] if before else []
            read = repo.load_config

            def begin(*given: Any, **how: Any) -> Any:
                return begun.pop() if begun else create(*given, **how)

            with pytest.MonkeyPatch.context() as alone:
                alone.setattr(OmegaConf, "create", begin)
                alone.setattr(repo, "load_config", lambda config_path: copied(read(config_path)))
                alone.setattr(DictConfig, "_re_parent", lambda _: None)  # but in the end
                config = merge(self, defaults[len(before) :], repo)
            config._re_parent()
            merged[key] = pickle.dumps(config)
        return merged[key]

    def mapped_if_read(overrides: Any, found: list[Any], self_added: bool) -> DictConfig | None:
        read = any(each.is_interpolation() for each in found)
        return choices(overrides, found, self_added) if read else None

    # with each composition Hydra copies the registered schemas, which it does not change
    patch.setattr(ConfigStore, "__deepcopy__", lambda store, _: store, raising=False)
    patch.setattr("omegaconf.base.parse", functools.cache(parse))
    patch.setattr(ConfigRepository, "load_config", once_loaded)
    patch.setattr(config_loader_impl, "create_defaults_list", once_listed)
    patch.setattr(defaults_list, "_create_interpolation_map", mapped_if_read)
    patch.setattr(ConfigLoaderImpl, "_compose_config_from_defaults_list", once_merged)


def copied(config: Any) -> Any:
    """Copy in a fifth of the time of ``copy.deepcopy``."""
    return pickle.loads(pickle.dumps(config))


def _is_own(repo: IConfigRepository) -> bool:
    return {source.path for source in repo.get_sources()} <= OWN
