"""Node, to run the page's own script without a browser."""

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tex_lightning.export import web_page

SOURCES = Path(web_page.__file__).parent / "web"


@pytest.fixture(scope="session")
def node(tmp_path_factory) -> Callable[..., Any]:
    """Run ``body`` with names of the page's modules and the plain values ``given``; its result."""
    if shutil.which("node") is None:
        pytest.skip("no node on the PATH")
    folder = tmp_path_factory.mktemp("script")
    for source in SOURCES.glob("*.js"):
        shutil.copy(source, folder)
    (folder / "package.json").write_text('{"type": "module"}')

    def run(imports: dict[str, str], body: str, **given: Any) -> Any:
        lines = [f'import {{ {names} }} from "./{module}.js";' for module, names in imports.items()]
        lines += ['import { readFileSync } from "node:fs";', f"const given = {json.dumps(given)};"]
        lines += [f"const result = await (async () => {{ {body} }})();"]
        lines += ["console.log(JSON.stringify(result));"]
        (folder / "run.js").write_text("\n".join(lines))
        done = subprocess.run(["node", "run.js"], cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run
