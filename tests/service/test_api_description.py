"""What the service says about itself: /docs without another host, and an OpenAPI document without holes."""

from __future__ import annotations

import re
from typing import Any
from urllib.parse import urljoin, urlsplit

import pytest
from pydantic import BaseModel
from small_service import SmallService

from service.reconstructions import CaptureAndReconstructionRequest, ReconstructionRequest
from service.weights import NAME_PATTERN

METHODS = ("get", "post", "put", "patch", "delete")
_LOADED = re.compile(r"""(?:src|href|url)\s*[=:]\s*["']([^"']+)["']""")
_ELSEWHERE = re.compile(rb"""(?:@import|url\()\s*["']?(?:https?:)?//""")


@pytest.fixture(scope="module")
def document(lasting: SmallService) -> dict[str, Any]:
    found: dict[str, Any] = lasting.client.get("/openapi.json").json()
    return found


def operations(document: dict[str, Any]) -> list[tuple[str, str, dict[str, Any]]]:
    return [(m, path, item[m]) for path, item in document["paths"].items() for m in METHODS if m in item]


def references(node: object) -> list[str]:
    """Every $ref in a document."""
    if isinstance(node, dict):
        own = [node["$ref"]] if isinstance(node.get("$ref"), str) else []
        return own + [r for value in node.values() for r in references(value)]
    return [r for value in node for r in references(value)] if isinstance(node, list) else []


def test_the_page_and_all_that_it_loads_come_from_here(lasting: SmallService) -> None:
    page = lasting.client.get("/docs")
    assert page.headers["content-type"].startswith("text/html")
    loaded = _LOADED.findall(page.text)
    assert {"/openapi.json"} < set(loaded)
    assert any(link.endswith(".js") for link in loaded)
    assert any(link.endswith(".css") for link in loaded)
    for link in loaded:
        assert urlsplit(urljoin("http://localhost/docs", link)).netloc == "localhost", link
        response = lasting.client.get(link)
        assert response.status_code == 200, link
        assert len(response.content) > 500, link
        if link.endswith(".css"):
            assert not _ELSEWHERE.search(response.content)


def test_every_operation_is_described(document: dict[str, Any]) -> None:
    found = operations(document)
    assert len(found) >= 30
    names = [operation["operationId"] for _, _, operation in found]
    assert len(set(names)) == len(names)
    for method, path, operation in found:
        where = f"{method} {path}"
        assert operation["summary"], where
        assert operation["tags"], where
        assert any(status.startswith("2") for status in operation["responses"]), where
        errors = {
            status: response
            for status, response in operation["responses"].items()
            if status == "default" or status >= "400"
        }
        assert "default" in errors, where
        for status, response in errors.items():
            if (path, status) == ("/v1/health/ready", "503"):
                continue  # the same checks as when it is ready
            assert list(response["content"]) == ["application/problem+json"], f"{where} {status}"
            schema = response["content"]["application/problem+json"]["schema"]
            assert schema == {"$ref": "#/components/schemas/Problem"}


def test_every_reference_leads_somewhere(document: dict[str, Any]) -> None:
    assert document["openapi"].startswith("3.1")
    for reference in references(document):
        node: Any = document
        for part in reference.removeprefix("#/").split("/"):
            node = node[part]
        assert node
    assert "HTTPValidationError" not in document["components"]["schemas"]


def test_every_body_says_what_may_stand_in_it(document: dict[str, Any]) -> None:
    schemas = document["components"]["schemas"]
    for name, schema in schemas.items():
        if name.endswith(("Request", "Patch")):
            assert schema["additionalProperties"] is False, name
            assert schema.get("description"), name


@pytest.mark.parametrize("model", [ReconstructionRequest, CaptureAndReconstructionRequest])
def test_examples_of_the_options_are_valid(document: dict[str, Any], model: type[BaseModel]) -> None:
    schema = document["components"]["schemas"][model.__name__]
    assert not {"method", "weights"} & set(schema.get("required", ()))
    assert NAME_PATTERN in str(schema["properties"]["weights"])
    examples = {name: field["examples"][0] for name, field in schema["properties"].items() if "examples" in field}
    assert {"method", "weights", "depth_range"} <= set(examples)
    model.model_validate({**dict.fromkeys(schema.get("required", ()), "x"), **examples})


def test_files_are_told_apart_by_their_types(document: dict[str, Any], lasting: SmallService) -> None:
    """What an operation gives is of a type that it documents."""
    answer = lasting.client.post("/v1/capture-and-reconstruct").json()
    for link in {**answer["links"], **answer["capture"]["links"]}.values():
        path = next(p for p in document["paths"] if _fits(p, link) and "get" in document["paths"][p])
        documented = document["paths"][path]["get"]["responses"]["200"]["content"]
        given = lasting.client.get(link).headers["content-type"].partition(";")[0]
        assert given in documented, f"{path} gives {given}, documented are {list(documented)}"


def _fits(template: str, path: str) -> bool:
    pattern = re.sub(r"\\\{\w+\\\}", "[^/]+", re.escape(template))
    return re.fullmatch(pattern, path) is not None
