"""The result of criticism as files: report.json, report.html, run.rrd; refined.toml and refined.xml; a picture."""

from onlinebayes.criticism.report.picture import write_picture
from onlinebayes.criticism.report.write import write_report

__all__ = ["write_picture", "write_report"]
