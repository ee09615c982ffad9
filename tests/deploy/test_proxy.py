"""Behind a proxy that ends TLS the page and the stream work, in a browser too."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from edge_service.config import DEFAULT_CONFIG
from tests.certificates import write_certificates
from tests.documents import ROOT, document
from tests.drivers.bench import free_port
from tests.programs import printed

PLACES = "/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin"
PROXIES = {name: shutil.which(name, path=PLACES) for name in ("nginx", "caddy")}
CURL, CHROMIUM = shutil.which("curl"), shutil.which("chromium")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(CURL is None, reason="curl is not installed")]
NGINX_MAIN = """daemon off; pid {folder}/nginx.pid; error_log stderr; worker_processes 1;
events {{ }}
http {{ access_log off; client_body_temp_path {folder}; proxy_temp_path {folder};
fastcgi_temp_path {folder}; uwsgi_temp_path {folder}; scgi_temp_path {folder};
include {folder}/edge-service.conf; }}
"""
CADDY_MAIN = "{ admin off\n auto_https disable_redirects\n default_bind 127.0.0.1\n }\n"
PATIENCE_MS = 120_000
COMMAND = [sys.executable, "-m", "edge_service"]


def asked(*line: str) -> str:
    return printed(*COMMAND, *line, folder=ROOT)


@contextmanager
def running(line: list[str], **more: str) -> Iterator["subprocess.Popen[str]"]:
    """A program, with more in its environment, until the test ends."""
    environment, pipe = os.environ | more, subprocess.PIPE
    with subprocess.Popen(line, cwd=ROOT, stdout=pipe, text=True, env=environment) as program:
        try:
            yield program
        finally:
            program.terminate()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, int, str]]:
    """Folder with certificates, port of the service, and the token of an operator."""
    folder = tmp_path_factory.mktemp("proxied")
    (folder / "certificates").mkdir()
    write_certificates(folder / "certificates", "edge-box")
    machine = DEFAULT_CONFIG.parent / "commissioned.toml"
    text = DEFAULT_CONFIG.read_text().replace('"commissioned.toml"', f'"{machine}"')
    text = text.replace("port = 8080", 'port = 0\nurl = "https://edge-box/"')
    text = text.replace("tcp/127.0.0.1:7447", "tcp/127.0.0.1:0")
    text = text.replace('# folder = "state"', 'folder = "state"')
    (folder / "edge.toml").write_text(text)
    line = ("token", str(folder / "edge.toml"), "--add", "Kim", "--role", "operator")
    token = asked(*line).split()[-1]
    with running([*COMMAND, "run", str(folder / "edge.toml")]) as program:
        assert program.stdout is not None
        port = int(program.stdout.readline().rstrip("/\n").rpartition(":")[2])
        yield folder, port, token


def nginx(folder: Path, own: int, port: int) -> list[str]:
    """Command that runs nginx with the site of the project."""
    site = document("deploy/nginx.conf").replace("listen 443 ssl", f"listen 127.0.0.1:{own} ssl")
    (folder / "edge-service.conf").write_text(at_home(site, folder, port))
    (folder / "nginx.conf").write_text(NGINX_MAIN.format(folder=folder))
    return ["-c", str(folder / "nginx.conf"), "-p", str(folder)]


def caddy(folder: Path, own: int, port: int) -> list[str]:
    """Command that runs Caddy with the site of the project."""
    site = document("deploy/Caddyfile").replace("https://edge-box", f"https://edge-box:{own}")
    (folder / "Caddyfile").write_text(CADDY_MAIN + at_home(site, folder, port))
    return ["run", "--adapter", "caddyfile", "--config", str(folder / "Caddyfile")]


def at_home(site: str, folder: Path, port: int) -> str:
    """A proxy's site with the service's port and the certificates of the test."""
    assert site.count("127.0.0.1:8080") >= 1
    site = site.replace("127.0.0.1:8080", f"127.0.0.1:{port}")
    return site.replace("/etc/edge-service/certificates", str(folder / "certificates"))


@pytest.fixture(scope="module", params=[nginx, caddy])
def proxy(request: pytest.FixtureRequest, service: tuple[Path, int, str]) -> Iterator[list[str]]:
    """A curl that asks the proxy by its name, and trusts the authority alone."""
    name = request.param.__name__
    if PROXIES[name] is None:
        pytest.skip(f"{name} is not installed")
    (folder, port, _), own = service, free_port()
    line = [str(PROXIES[name]), *request.param(folder, own, port)]
    home = {f"XDG_{each}_HOME": str(folder) for each in ("DATA", "CONFIG")}
    with running(line, **home):
        curl = [str(CURL), "--silent", "--show-error", "--max-time", "20", "--noproxy", "*"]
        curl += ["--cacert", str(folder / "certificates" / "ca.pem")]
        curl += ["--resolve", f"edge-box:{own}:127.0.0.1", "--retry", "20"]
        yield [*curl, "--retry-connrefused", "--retry-delay", "1", f"https://edge-box:{own}"]


def fetch(proxy: list[str], path: str, *more: str) -> tuple[int, str]:
    """Status and body."""
    said = printed(*proxy[:-1], *more, "--write-out", "\n%{http_code}", proxy[-1] + path)
    body, _, status = said.rpartition("\n")
    return int(status), body


def bearer(service: tuple[Path, int, str]) -> tuple[str, str]:
    return ("--header", f"Authorization: Bearer {service[2]}")


def test_the_page_is_there_with_a_token_and_nothing_without(
    proxy: list[str], service: tuple[Path, int, str]
) -> None:
    status, body = fetch(proxy, "/", "--user", f"whoever:{service[2]}")
    assert status == 200
    assert "<html" in body
    assert fetch(proxy, "/")[0] == 401
    assert fetch(proxy, "/healthz")[0] == 200


def test_another_name_is_refused(proxy: list[str], service: tuple[Path, int, str]) -> None:
    assert fetch(proxy, "/api/v1/axes", *bearer(service))[0] == 200
    foreign = ("--header", "Host: evil.example")
    status, body = fetch(proxy, "/api/v1/axes", *bearer(service), *foreign)
    assert status in (400, 403, 421) or body == ""  # Caddy answers for no site: with nothing


@pytest.mark.parametrize(("origin", "status"), [(None, 202), ("https://evil.example", 403)])
def test_a_command_of_its_own_page_is_taken(
    origin: str | None, status: int, proxy: list[str], service: tuple[Path, int, str]
) -> None:
    command = json.dumps({"action": "note", "user": "Kim", "note": "greased"})
    more = ("--header", "Content-Type: application/json", "--data", command)
    said = fetch(
        proxy,
        "/api/v1/axes/X/commands",
        *(*bearer(service), *more, "--header", f"Origin: {origin or proxy[-1]}"),
    )
    assert said[0] == status, said[1]


def test_stream_arrives_while_it_goes_on(proxy: list[str], service: tuple[Path, int, str]) -> None:
    line = [*proxy[:-1], "--no-buffer", *bearer(service), proxy[-1] + "/api/v1/events"]
    with running(line) as client:
        assert client.stdout is not None
        heard = (each for each in client.stdout if each.startswith("data:"))
        assert json.loads(next(heard).removeprefix("data:"))
        next(heard)
        assert client.poll() is None  # the answer has not ended


def test_a_person_sees_the_numbers_change(proxy: list[str], service: tuple[Path, int, str]) -> None:
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    resolved = ["--no-sandbox", "--host-resolver-rules=MAP edge-box 127.0.0.1"]
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=resolved)
        context = browser.new_context(
            ignore_https_errors=True,
            http_credentials={"username": "whoever", "password": service[2]},
        )
        page, asked = context.new_page(), []
        page.set_default_timeout(PATIENCE_MS)
        page.on("request", lambda request: asked.append(request.url))
        page.goto(proxy[-1])
        page.wait_for_selector("#answer .sure:not(:empty)")
        first = page.inner_text("#answer .sure")
        page.locator("#answer .sure", has_not_text=first).wait_for()
        assert all(url.startswith((proxy[-1], "data:")) for url in asked)
        assert sum("/api/v1/events" in url for url in asked) <= 2
        browser.close()
