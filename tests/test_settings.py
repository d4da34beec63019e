"""The configuration: file, environment, command line, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.settings import ConfigurationError, load_settings

KEY = "a-key-of-sixteen-or-more"


def _file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_nothing_given_serves_on_loopback_only() -> None:
    settings = load_settings()
    assert settings.server.is_loopback
    assert settings.rig.driver == "auto"


def test_the_environment_goes_before_the_file_and_options_before_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = _file(tmp_path, '[server]\nport = 1\nhost = "localhost"\n[rig]\ndriver = "simulated"\n')
    assert load_settings(file).server.port == 1
    monkeypatch.setenv("DUOFRINGE_SERVER__PORT", "2")
    settings = load_settings(file)
    assert (settings.server.port, settings.server.host, settings.rig.driver) == (2, "localhost", "simulated")
    assert load_settings(file, {"server": {"port": 3}}).server.port == 3


def test_paths_in_the_file_are_beside_it(tmp_path: Path) -> None:
    settings = load_settings(_file(tmp_path, '[rig]\ndriver = "replay"\nreplay = "sets/a"\n'))
    assert settings.rig.replay == tmp_path / "sets" / "a"


def test_the_weights_folder_is_in_the_library_unless_named(tmp_path: Path) -> None:
    text = '[library]\nfolder = "kept"\n'
    assert load_settings(_file(tmp_path, text)).library.weights == tmp_path / "kept" / "weights"
    named = load_settings(_file(tmp_path, f'{text}weights_folder = "learned"\n'))
    assert named.library.weights == tmp_path / "learned"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[rig]\ndrivr = 1\n", "rig.drivr"),
        ('[rig]\ndriver = "laser"\n', "rig.driver"),
        ("[server]\nport = 99999\n", "server.port"),
        ("[server\n", "TOML"),
        ('[server]\nhost = "0.0.0.0"\n', "DUOFRINGE_API_KEYS"),
        ('[acquisition]\npreview_pattern = "plaid"\n', "preview_pattern"),
        ("[acquisition.audit]\nnonsense = 1\n", "acquisition.audit.nonsense"),
    ],
)
def test_mistakes_are_one_line_that_names_the_key(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(ConfigurationError, match=told) as caught:
        load_settings(_file(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert "rig.toml" in str(caught.value)


def test_an_empty_preview_pattern_is_dark(tmp_path: Path) -> None:
    assert load_settings(_file(tmp_path, '[acquisition]\npreview_pattern = ""\n')).acquisition.preview_pattern is None


def test_keys_open_the_door_to_the_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DUOFRINGE_API_KEYS", f"{KEY}, {KEY}-2")
    settings = load_settings(given={"server": {"host": "0.0.0.0"}})
    assert len(settings.api_keys) == 2
    assert KEY not in repr(settings)


def test_a_short_key_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DUOFRINGE_API_KEYS", "short")
    with pytest.raises(ConfigurationError, match="16 characters"):
        load_settings()


@pytest.mark.parametrize("name", ["replay.toml", "bench.toml"])
def test_the_examples_are_valid(name: str) -> None:
    load_settings(Path(__file__).parents[1] / "examples" / "configuration" / name)
