"""The service's configuration: one TOML file, the environment over it.

Every key can be set in the environment as ``DUOFRINGE_`` and its path with double underscores:
``DUOFRINGE_RIG__DRIVER=replay``. Paths in the file are relative to the file's folder, those in the environment to the
working folder.
"""

from __future__ import annotations

import ipaddress
import tomllib
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, SecretStr, ValidationError, field_validator, model_validator
from pydantic_settings import (
    BaseSettings,
    InitSettingsSource,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    SettingsError,
)

from drivers.registry import RigConfiguration
from models.errors import DuofringeError
from service.acquisition.settings import AcquisitionSettings

MEBIBYTE = 1 << 20
_PATHS = (
    ("library", "folder"),
    ("library", "weights_folder"),
    ("library", "datasets_folder"),
    ("rig", "replay"),
    ("rig", "calibration"),
    ("rig", "projector", "manifest"),
)
_SHORTEST_KEY = 16


class ConfigurationError(DuofringeError):
    """The configuration is unreadable, or says something impossible."""


class ServerSettings(BaseModel):
    """host: without API keys only the loopback interface is served. max_*: bytes of a request's body."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str = "127.0.0.1"
    port: int = Field(8000, ge=0, le=65535)
    allowed_hosts: tuple[str, ...] = ("localhost", "127.0.0.1", "[::1]")
    max_body_bytes: int = Field(MEBIBYTE, ge=1024)
    max_upload_bytes: int = Field(512 * MEBIBYTE, ge=1024)

    @property
    def is_loopback(self) -> bool:
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False


class LibrarySettings(BaseModel):
    """folder: where captures and reconstructions are kept. minimum_free_bytes: below this nothing more is written.

    weights_folder: holds folders of the refiner's weights, which requests may name; None for ``weights`` in ``folder``.
    datasets_folder: likewise of datasets, to train on and to evaluate with; None for ``datasets`` in ``folder``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    folder: Path = Path("duofringe-library")
    minimum_free_bytes: int = Field(512 * MEBIBYTE, ge=0)
    weights_folder: Path | None = None
    datasets_folder: Path | None = None

    @property
    def weights(self) -> Path:
        """The weights folder, which need not exist."""
        return self.weights_folder or self.folder / "weights"

    @property
    def datasets(self) -> Path:
        """The datasets folder, which need not exist."""
        return self.datasets_folder or self.folder / "datasets"


class ServiceSettings(BaseSettings):
    """All of it. api_keys: comma-separated in the environment (``DUOFRINGE_API_KEYS``)."""

    model_config = SettingsConfigDict(
        env_prefix="DUOFRINGE_",
        env_nested_delimiter="__",
        extra="forbid",
        frozen=True,
        nested_model_default_partial_update=True,
    )
    file_content: ClassVar[dict[str, Any]] = {}

    server: ServerSettings = Field(default_factory=ServerSettings)
    library: LibrarySettings = Field(default_factory=LibrarySettings)
    rig: RigConfiguration = Field(default_factory=RigConfiguration)
    acquisition: AcquisitionSettings = Field(default_factory=AcquisitionSettings)
    api_keys: Annotated[tuple[SecretStr, ...], NoDecode] = ()

    @field_validator("api_keys", mode="before")
    @classmethod
    def _split_keys(cls, value: object) -> object:
        if isinstance(value, str):
            return tuple(key.strip() for key in value.split(",") if key.strip())
        return value

    @model_validator(mode="after")
    def _open_doors_need_keys(self) -> ServiceSettings:
        if any(len(key.get_secret_value()) < _SHORTEST_KEY for key in self.api_keys):
            raise ValueError(f"api_keys: a key needs at least {_SHORTEST_KEY} characters")
        if not self.server.is_loopback and not self.api_keys:
            raise ValueError(
                f"server.host {self.server.host} is open to the network; set DUOFRINGE_API_KEYS or serve on 127.0.0.1"
            )
        return self

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        return init_settings, env_settings, InitSettingsSource(settings_cls, cls.file_content)


def load_settings(config: Path | None = None, given: dict[str, Any] | None = None) -> ServiceSettings:
    """Settings from a TOML file, the environment over it, and ``given`` over both.

    Raises ConfigurationError in one line.
    """
    content = {} if config is None else _read(config)

    class Configured(ServiceSettings):
        file_content: ClassVar[dict[str, Any]] = content

    where = "configuration" if config is None else str(config)
    try:
        return Configured(**(given or {}))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        message = first["msg"].removeprefix("Value error, ")
        raise ConfigurationError(f"{where}: {place}: {message}" if place else f"{where}: {message}") from error
    except SettingsError as error:
        raise ConfigurationError(f"environment: {error}") from error


def _read(path: Path) -> dict[str, Any]:
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigurationError(f"configuration '{path}' is not readable as TOML ({error})") from error
    for *sections, key in _PATHS:
        table: Any = content
        for section in sections:
            table = table.get(section) if isinstance(table, dict) else None
        if isinstance(table, dict) and isinstance(table.get(key), str):
            table[key] = path.parent / Path(table[key]).expanduser()
    return content
