"""A finished run, or a search for one, as one HTML file that can be mailed."""

from report.page.page import write_page as write_page
