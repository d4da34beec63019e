"""Uploads and paths made to do harm: each is refused in words, costs little memory, and harms nobody."""

from __future__ import annotations

import http.client
import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from urllib.parse import urlsplit

import httpx2
import pytest
from problem_checks import problem

from benchmarks.service_process import ServiceProcess

MOST_MIB = 200.0
MIB = 2**20
_ZIP = {"Content-Type": "application/zip"}
Files = dict[str, bytes]


@pytest.fixture(scope="module")
def files(live: ServiceProcess) -> Files:
    """A capture as the service gives it, by place in its folder."""
    with live.client() as client:
        taken = client.post("/v1/captures", json={"plan": "composite"}).raise_for_status().json()
        content = client.get(taken["links"]["archive"]).content
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name.partition("/")[2]: archive.read(name) for name in archive.namelist()}


@pytest.fixture(autouse=True)
def unharmed(live: ServiceProcess) -> Iterator[None]:
    """The process stays within its memory, keeps nothing of what it refused, and goes on working."""
    with live.client() as client:
        before = _captures(client)
        live.forget_highest_memory()
        memory = live.memory_mib
        yield
        taken = live.highest_memory_mib - memory
        assert taken < MOST_MIB, f"{taken:.0f} MiB were taken"
        assert _captures(client) == before
        assert client.post("/v1/captures", json={}).status_code == 201
    hidden = [path.name for path in (live.library / "captures").iterdir() if path.name.startswith(".")]
    assert hidden == []
    assert list((live.library / ".work").iterdir()) == []


def _captures(client: httpx2.Client) -> list[str]:
    return [item["id"] for item in client.get("/v1/captures?limit=200").raise_for_status().json()["items"]]


def packed(files: Files, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", method) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return made.getvalue()


def upload(live: ServiceProcess, content: bytes | Iterator[bytes], **headers: str) -> httpx2.Response:
    with live.client() as client:
        return client.post("/v1/captures/import", content=content, headers={**_ZIP, **headers})


def png(width: int, height: int, rows: bytes = b"") -> bytes:
    """A grey image that is black where ``rows`` end."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    packer = zlib.compressobj(9)
    data = packer.compress(rows)
    for _ in range(height):
        data += packer.compress(bytes(width + 1))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data + packer.flush()) + chunk(b"IEND", b"")


def resized(image: bytes, side: int) -> bytes:
    """The same data, said to be of another size."""
    header = b"IHDR" + struct.pack(">II", side, side) + image[24:29]
    return image[:12] + header + struct.pack(">I", zlib.crc32(header)) + image[33:]


def npy(shape: tuple[int, ...], body: int, kind: str = "<f4") -> bytes:
    header = repr({"descr": kind, "fortran_order": False, "shape": shape}).encode()
    header = header.ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(body)


def lying(content: bytes, *, size: int) -> bytes:
    """The archive with every entry said to be of ``size`` bytes, in both of its directories."""
    made = bytearray(content)
    for signature, at in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        for found in re.finditer(re.escape(signature), content):
            struct.pack_into("<I", made, found.start() + at, size)
    return bytes(made)


def deep(levels: int) -> bytes:
    return b'{"notes": ' + b"[" * levels + b"]" * levels + b"}"


ARCHIVES: dict[str, Callable[[Files], bytes]] = {
    "an image of 240 MiB of zeros": lambda f: packed({**f, "left/composite.png": bytes(240 * MIB)}),
    "four files of 60 MiB of zeros": lambda f: packed({**f, **{f"truth/t{n}.npy": bytes(60 * MIB) for n in range(4)}}),
    "a zip in a zip in a zip": lambda f: packed({"a.zip": packed({"b.zip": packed({"c": bytes(9 * MIB)})})}),
    "zips in place of images": lambda f: packed({n: packed({"x": bytes(30 * MIB)}) for n in f}),
    "5000 entries": lambda f: packed({**f, **{f"left/p{n}.png": b"" for n in range(5000)}}),
    "60000 entries": lambda f: packed({f"{n}": b"" for n in range(60_000)}),
    "sizes said to be small": lambda f: lying(packed({**f, "left/composite.png": bytes(150 * MIB)}), size=100),
    "images of 100 megapixels": lambda f: packed(
        {n: png(10_000, 10_000) if n[-3:] == "png" else c for n, c in f.items()}
    ),
    "an image said to have 100 megapixels": lambda f: packed({**f, "left/composite.png": png(10_000, 10_000)[:200]}),
    "an image said to have 2**62 pixels": lambda f: packed({**f, "left/composite.png": resized(png(8, 8), 2**31 - 1)}),
    "truth said to be endless": lambda f: packed({**f, "truth/depth.npy": npy((10**9, 10**9), 64)}),
    "truth of objects": lambda f: packed({**f, "truth/depth.npy": npy((480, 640), 64, "|O")}),
    "truth of 180 MiB": lambda f: packed({**f, "truth/depth.npy": npy((480, 98_304), 180 * MIB)}),
    "a record of 100 MiB": lambda f: packed({**f, "capture.json": b"[" + b" " * 100 * MIB + b"]"}),
    "a record nested 100000 deep": lambda f: packed({**f, "capture.json": deep(100_000)}),
    "a record with infinity": lambda f: packed({**f, "capture.json": b'{"plan": Infinity, "x": 1e999}'}),
    "a name that climbs": lambda f: packed({**f, "../../escaped.png": b"x"}),
    "a name that climbs within": lambda f: packed({**f, "left/../../escaped.png": b"x"}),
    "an absolute name": lambda f: packed({**f, "/tmp/escaped.png": b"x"}),
    "a name with a drive": lambda f: packed({**f, "C:\\escaped.png": b"x"}),
    "a name with backslashes": lambda f: packed({**f, "..\\escaped.png": b"x"}),
    "a name with a zero": lambda f: packed({**f, "left/zero__.png": b"x"}).replace(b"zero__", b"zero\x00_"),
    "two captures": lambda f: packed({**f, **{f"other/{n}": c for n, c in f.items()}}),
    "bzip2": lambda f: packed(f, zipfile.ZIP_BZIP2),
    "half an archive": lambda f: packed(f)[: len(packed(f)) // 2],
    "nothing": lambda f: b"",
    "an end without a beginning": lambda f: packed(f)[-22:],
    "a directory that leads nowhere": lambda f: packed(f)[:-6] + b"\xff\xff\xff\x7f\x00\x00",
}


@pytest.mark.parametrize("kind", list(ARCHIVES))
def test_a_hostile_archive_is_refused(live: ServiceProcess, files: Files, kind: str) -> None:
    content = ARCHIVES[kind](files)
    assert len(content) < 64 * MIB
    body = problem(upload(live, content), 422, "archive-invalid")
    assert "Error" not in body["detail"]
    assert "\n" not in body["detail"]
    assert str(live.library) not in body["detail"]
    assert not list(live.library.parent.rglob("*escaped*"))


def test_a_link_in_an_archive_is_refused(live: ServiceProcess, files: Files) -> None:
    made = io.BytesIO(packed(files))
    with zipfile.ZipFile(made, "a") as archive:
        link = zipfile.ZipInfo("left/link.png")
        link.external_attr = 0o120777 << 16
        archive.writestr(link, "/etc/passwd")
    problem(upload(live, made.getvalue()), 422, "archive-invalid")


@pytest.mark.parametrize("said", [None, 50 * MIB])
def test_an_archive_without_harm_is_taken(live: ServiceProcess, files: Files, said: int | None) -> None:
    """Also where it says that its files are larger than they are: that is not believed either."""
    content = packed(files)
    taken = upload(live, content if said is None else lying(content, size=said))
    assert taken.status_code == 201, taken.text
    links = taken.json()["links"]
    with live.client() as client:
        assert client.get(links["image_left_composite"]).content == files["left/composite.png"]
        assert client.delete(links["self"]).status_code == 204


@pytest.mark.parametrize("declared", [True, False])
def test_an_upload_over_the_limit_is_cut_short(live: ServiceProcess, declared: bool) -> None:
    size = 70 * MIB
    chunks = (b"\x00" * MIB for _ in range(70))
    try:
        response = upload(live, chunks, **({"Content-Length": str(size)} if declared else {}))
    except httpx2.WriteError:
        return  # the connection was closed while the rest was still on its way
    problem(response, 413, "too-large")


def test_a_body_over_the_limit_is_cut_short(live: ServiceProcess) -> None:
    with live.client() as client:
        for content in (b" " * (2 * MIB), (b" " * MIB for _ in range(30))):
            try:
                response = client.post("/v1/captures", content=content, headers={"Content-Type": "application/json"})
            except httpx2.WriteError:
                continue
            problem(response, 413, "too-large")


def test_a_body_of_nothing_but_brackets(live: ServiceProcess) -> None:
    with live.client() as client:
        headers = {"Content-Type": "application/json"}
        for content in ("[" * MIB, "[" * (MIB // 2) + "]" * (MIB // 2), '{"a":' * (MIB // 8)):
            problem(client.post("/v1/captures", content=content, headers=headers), 422, "validation")


@pytest.mark.parametrize(
    "target",
    [
        "/v1/captures/../../../../etc/passwd",
        "/v1/captures/..%2f..%2f..%2fetc%2fpasswd",
        "/v1/captures/%2e%2e/%2e%2e/capture.json",
        "/v1/captures/%2e%2e%2f/archive.zip",
        "/v1/captures/..%5c..%5cx/archive.zip",
        "/v1/captures/%252e%252e%252f/archive.zip",
        "/v1/captures/x%00.png",
        "/v1/captures/{id}/images/left/..%2f..%2fcapture.json",
        "/v1/captures/{id}/images/left/%2e%2e%2fcomposite.png",
        "/v1/captures/{id}/images/left/../capture.json.png",
        "/v1/captures/{id}%2fcapture.json",
        "/v1/captures/{id}%2f..%2f{id}/archive.zip",
        "/v1/reconstructions/..%2fcaptures%2f{id}/points.ply",
        "/v1/reconstructions/{id}/report",
        "/v1/problems/..%2f..%2f",
        "/static-offline-docs/../../../../../../etc/passwd",
        "/static-offline-docs/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/static-offline-docs/..%2f..%2fcore.py",
        "//etc/passwd",
        "/v1/captures/" + "a" * 30_000,
    ],
)
def test_a_path_that_leads_astray_leads_nowhere(live: ServiceProcess, files: Files, target: str) -> None:
    del files  # a capture is there
    with live.client() as client:
        stored = _captures(client)[0]
    connection = http.client.HTTPConnection(urlsplit(live.url).netloc, timeout=10)
    connection.putrequest("GET", target.replace("{id}", stored))  # as it is, not tidied up
    connection.endheaders()
    response = connection.getresponse()
    content = response.read()
    connection.close()
    assert response.status in (404, 422), content[:300]
    assert response.headers["content-type"] == "application/problem+json"
    assert json.loads(content)["status"] == response.status
    assert b"root:" not in content
