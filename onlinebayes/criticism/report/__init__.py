"""The result of criticism as files: report.json, report.html, run.rrd; refined.toml and refined.xml."""

from onlinebayes.criticism.report.refined import write_refined
from onlinebayes.criticism.report.write import write_report

__all__ = ["write_refined", "write_report"]
