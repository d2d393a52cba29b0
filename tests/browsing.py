"""Pages with a script in a real browser."""

import base64
import hashlib
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
CONTROLS = "#live input, #live select, #live button"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser without a window."""
    sync = pytest.importorskip("playwright.sync_api", reason="needs pip install 'rock2d[browser]'")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"needs a browser: {' or '.join(BROWSERS)}")
    with sync.sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield started
        started.close()


def opened(browser: Any, path: Path, state: str = "") -> tuple[Any, list[str]]:
    """A page with its live view, and what its browser complains of or asks for."""
    page, seen = browser.new_page(viewport={"width": 1280, "height": 1000}), []
    page.on("console", lambda message: seen.append(message.text))
    page.on("pageerror", lambda error: seen.append(str(error)))
    page.on("request", lambda asked: seen.append(asked.url) if not asked.url.startswith("data:") else None)
    page.goto(path.as_uri() + state)
    page.wait_for_selector("#live:not([hidden])")
    return page, seen


def until(page: Any, holds: Callable[[], bool]) -> None:
    """Wait, at most 5 s; the policy of the page refuses what playwright itself would wait with."""
    for _ in range(250):
        if holds():
            return
        page.wait_for_timeout(20)
    raise AssertionError("still waiting")


def ask_for_release(page: Any, number: object) -> None:
    """Type the number of a release into its field."""
    page.locator("#live-release").fill(str(number))
    page.keyboard.press("Enter")


def picture(page: Any, name: str) -> str:
    """What the canvases of this name show."""
    return page.evaluate(f"[...document.querySelectorAll('{name}')].map(c => c.hidden ? '' : c.toDataURL()).join()")


def assert_only_its_own_script_may_run(text: str) -> None:
    """The page has one script, and its policy allows this one alone."""
    code = text[text.rindex("<script>") + 8 : text.rindex("</script>")]
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    policy = text.split('http-equiv="Content-Security-Policy" content="', 1)[1].split('"', 1)[0]
    assert policy.startswith("default-src 'none';") and policy.endswith(f"script-src 'sha256-{digest}'")
    assert text.count("<script") == 2 and text.count("<script type=") == 1


@contextmanager
def on_a_phone(page: Any) -> Iterator[None]:
    """The page on a narrow screen, where nothing may be scrolled sideways."""
    page.set_viewport_size({"width": 390, "height": 844})
    yield
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    page.set_viewport_size({"width": 1280, "height": 1000})


def assert_nothing_else_was_run_or_loaded(page: Any, seen: list[str], *own: Path) -> None:
    """No complaint, no address but those of the page and its files; a script that comes later does not run."""
    assert page.url.split("#")[0] in (addresses := {text.split("#")[0] for text in seen})
    assert addresses <= {path.as_uri() for path in own}
    other = "() => { const own = document.createElement('script'); own.textContent = 'window.other = 1';"
    assert page.evaluate(f"{other} document.body.append(own); return window.other }}") is None


def assert_not_printed_and_all_named(page: Any, fewest: int = 13) -> None:
    """The live view has so many controls, each has a name, and the view is not printed."""
    named = "all => all.every(c => c.labels?.[0]?.textContent.trim() || c.textContent.trim())"
    assert page.locator(CONTROLS).count() >= fewest and page.eval_on_selector_all(CONTROLS, named)
    page.emulate_media(media="print")
    assert page.locator("#live").is_hidden() and page.locator("h1").is_visible()
    page.emulate_media(media="screen")
    assert page.locator("#live").is_visible()
