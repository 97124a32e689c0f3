"""Chromium of the system, driven by Playwright, and axe on the pages that it opens."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

AXE = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}


@contextmanager
def chromium(path: str) -> Iterator[Any]:
    """A browser without a window."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])  # root in a container
        yield browser
        browser.close()


class SeenPage:
    """A page of the browser with what its console said."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.said: list[str] = []
        page.on("console", lambda message: self.said.append(message.text))
        page.on("pageerror", lambda error: self.said.append(str(error)))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.page, name)

    def violations(self) -> list[str]:
        """What axe finds: contrast, names, roles, order of headings."""
        from axe_playwright_python.sync_playwright import Axe

        found = Axe().run(self.page, options=AXE).response["violations"]
        return [f"{v['id']}: {node['target']} {node['failureSummary']}" for v in found for node in v["nodes"]]


@contextmanager
def open_page(browser: Any, file: Path, **options: Any) -> Iterator[SeenPage]:
    """The page of a file, ready, in a window of its own."""
    context = browser.new_context(**{"viewport": {"width": 1200, "height": 900}, **options})
    page = SeenPage(context.new_page())
    page.goto(file.as_uri())
    page.wait_for_selector("html[data-ready]", state="attached")
    yield page
    context.close()
