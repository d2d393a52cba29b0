"""Write pages as PDF with WeasyPrint, an optional package."""

from __future__ import annotations

from pathlib import Path

from rock2d.errors import InputError
from rock2d.files.folders import atomic_file

EXTRA = "pip install 'rock2d[pdf]'"


def check_printer() -> None:
    """Raise InputError if WeasyPrint, or a system library that it needs, is missing."""
    try:
        import weasyprint  # noqa: F401
    except ImportError:
        raise InputError(
            f"a PDF needs WeasyPrint: {EXTRA}", code="missing_package", package="weasyprint"
        ) from None
    except OSError as error:  # pip does not install Pango
        message = f"WeasyPrint does not find a library that it needs: {str(error).splitlines()[0]}"
        raise InputError(message, code="missing_package", package="weasyprint") from None


def write_pdf(page: str, path: Path) -> None:
    """Write a page as PDF, without access to files or the network. Raises InputError as `check_printer` does."""
    check_printer()
    from weasyprint import HTML
    from weasyprint.urls import URLFetcher

    fetcher = URLFetcher(allowed_protocols={"data"})
    with atomic_file(path) as part:
        HTML(string=page, url_fetcher=fetcher).write_pdf(part)
