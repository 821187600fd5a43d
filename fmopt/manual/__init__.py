"""The manual: pages of Markdown beside this file, and how they become one page that opens and is searched offline."""

from fmopt.manual.book import FOLDER, PAGES, manual

__all__ = ["FOLDER", "PAGES", "manual"]
