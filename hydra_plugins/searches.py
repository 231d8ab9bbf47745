"""The folders of configs by the name that Hydra knows: it takes plugins from here alone."""

from __future__ import annotations

from pathlib import Path

from hydra.core.config_search_path import ConfigSearchPath
from hydra.plugins.search_path_plugin import SearchPathPlugin

CONF = Path(__file__).parents[1] / "conf"


class EarlierNames(SearchPathPlugin):
    """conf/earlier: names of choices that are settings of others by now, which still compose."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Added to our own configs only: the plugin is found by every program of Hydra's."""
        own = (Path(source.path.removeprefix("file://")) for source in search_path.get_path())
        if CONF in own:
            search_path.append("earlier", f"file://{CONF / 'earlier'}")
