"""The documents say what is so."""

import re
import runpy
import shutil
from pathlib import Path

import pytest

import clsim
from clsim.events.files import FORMATS
from clsim.scene import load_world
from tests.shared_kernels import ORDINARY, widen
from tools.pages.scene_formats import section
from tools.pages.scene_keys import text

ROOT = Path(__file__).parents[2]


def test_the_table_of_scene_keys_is_current() -> None:
    page = "docs/reference/scene-keys.md"
    assert (ROOT / page).read_text() == text(), f"run: python -m tools.pages.scene_keys {page}"


def test_what_is_read_of_other_programs_is_current() -> None:
    assert section() in (ROOT / "docs" / "scene-formats.md").read_text(), (
        "its table is not that of tools.pages.scene_formats"
    )


def test_the_example_scene_is_one(tmp_path: Path) -> None:
    example = re.search(r"```toml\n(.*?)```", (ROOT / "docs" / "scenes.md").read_text(), re.DOTALL)
    assert example is not None
    scene = tmp_path / "example.toml"
    scene.write_text(example[1])
    world = load_world(scene)
    assert len(world.instances) == 3 and world.duration_s == 1.0


def test_every_file_format_is_documented() -> None:
    page = (ROOT / "docs" / "formats.md").read_text()
    for known in FORMATS:
        for ending in known.endings:
            assert f"`{ending}`" in page, ending


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))], ids=lambda p: str(p.relative_to(ROOT))
)
def test_links_and_pictures_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} points to {target}"


def test_guides_are_short() -> None:
    index = (ROOT / "docs" / "index.md").read_text()
    for part in ("Start", "Guides"):
        listed = re.search(rf":caption: {part}\n\n(.*?)```", index, re.DOTALL)
        assert listed is not None
        for name in listed[1].split():
            assert len((ROOT / "docs" / f"{name}.md").read_text().splitlines()) <= 150, name


def test_each_page_is_in_the_table_of_contents() -> None:
    index = (ROOT / "docs" / "index.md").read_text()
    pages = {str(path.relative_to(ROOT / "docs").with_suffix("")) for path in (ROOT / "docs").rglob("*.md")}
    listed = {name for block in re.findall(r"```{toctree}\n(.*?)```", index, re.DOTALL) for name in block.split()}
    assert pages - listed == {"index"}


def test_the_reference_has_every_option() -> None:
    """As `--help` has them: the page is made of the parser."""
    import typer.main

    from clsim.cli.app import app

    made = runpy.run_path(str(ROOT / "docs" / "site" / "made.py"))["filled"]("<!-- made: commands -->")
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert all(f"## clsim {name}" in made for name in commands)
    for param in (param for command in commands.values() for param in command.params):
        if param.param_type_name == "option":
            assert all(f"`{name}`" in made for name in param.opts) and " ".join(param.help.split()[:3]) in made


LIBRARY = [
    block
    for page in ("library.md", "other-libraries.md")
    for block in re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)
]
(READ_ALL,) = (block for block in LIBRARY if block.endswith('events = clsim.open("events.aedat4").read()\n'))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """A folder with events.aedat4, of the size that the examples name."""
    folder = tmp_path_factory.mktemp("library")
    with pytest.MonkeyPatch.context() as monkeypatch:
        widen(monkeypatch, request, ORDINARY)
        for _ in clsim.stream(
            "cornell", resolution=(64, 48), spp=1, frame_count=4, outputs=(str(folder / "events.aedat4"),)
        ):
            pass
    return folder


@pytest.mark.parametrize("block", LIBRARY, ids=range(len(LIBRARY)))
def test_python_in_the_page_on_the_library_runs(
    block: str, recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for library in re.findall(r"^(?:import|from) (\w+)", block, re.MULTILINE):
        pytest.importorskip(library, reason=f"{library} is not installed")
    for name in ("events.aedat4", "events.aedat4.json"):
        shutil.copy(recorded / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for code in (READ_ALL, block):
        exec(compile(code, "library.md", "exec"), names)
    assert len(names["events"]) > 0


def test_python_in_the_readme_runs() -> None:
    for block in re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL):
        shortened = block.replace("duration_s=0.1", 'quality="draft", frame_count=2, resolution=(16, 12)')
        assert shortened != block
        exec(compile(shortened, "README.md", "exec"), {})


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "CONTRIBUTING.md"], ids=lambda p: p.name)
def test_commands_name_options_that_exist(page: Path) -> None:
    """Every `clsim COMMAND --option` of a block of commands is one that the command has."""
    import typer.main

    from clsim.cli.app import app

    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    for block in re.findall(r"```sh\n(.*?)```", page.read_text(), re.DOTALL):
        for line in re.findall(r"^clsim (\w+)(.*)$", block, re.MULTILINE):
            command = commands[line[0]]
            if hasattr(command, "commands"):
                command = command.commands[line[1].split()[0]]
            known = {name for each in command.params for name in (*each.opts, *each.secondary_opts)}
            used = {word for word in line[1].partition("#")[0].split() if word.startswith("--")}
            assert used <= known, (line, used - known)
