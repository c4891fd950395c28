"""What the tests have: Chromium, pages of the server under test, and servers of their own."""

import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

from play import Play


@pytest.fixture(scope="session")
def url():
    return os.environ["GNP_URL"]


@pytest.fixture(scope="session")
def program():
    """The program that serves, for its other commands."""
    return os.environ["GNP_PROGRAM"]


@pytest.fixture(scope="session")
def browser():
    with sync_playwright() as playwright:
        # Without its sandbox: a container may have none.
        browser = playwright.chromium.launch(executable_path=os.environ["GNP_CHROMIUM"], args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def page_of(browser, url):
    """Makes pages, and in the end requires of each that it did nothing wrong but what `allowed` matches."""
    contexts, plays = [], []

    def make(link=None, server=url, allowed=None, **options):
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
        contexts.append(context)
        play = Play(context.new_page(), server)
        plays.append((play, allowed))
        return play.open() if link is None else play.open(link)

    yield make
    for context in contexts:
        context.close()
    for play, allowed in plays:
        assert [trouble for trouble in play.troubles if not (allowed and re.search(allowed, trouble))] == []


@pytest.fixture
def picture():
    """Keeps a picture of a page for somebody to look at, where GNP_PICTURES names a folder."""
    folder = os.environ.get("GNP_PICTURES")

    def take(play, name, **options):
        if folder:
            Path(folder).mkdir(parents=True, exist_ok=True)
            play.page.screenshot(path=Path(folder) / f"{name}.png", **options)

    return take


class Server:
    """A server of a test's own, which it may stop."""

    def __init__(self, program, port=0):
        command = [program, "play", "--port", str(port), "--recording", "us101-18_1"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        line = next(line for line in self.process.stdout if "http://" in line)
        self.url = re.search(r"http://[\d.]+:\d+", line).group()

    def stop(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout=10)


@pytest.fixture
def server_of(program):
    servers = []

    def start(port=0):
        servers.append(Server(program, port))
        return servers[-1]

    yield start
    for server in servers:
        server.stop()
