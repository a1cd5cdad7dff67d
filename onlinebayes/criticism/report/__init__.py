"""The result of criticism as files: report.json, report.html, run.rrd; refined.toml and refined.xml; a picture.

The sentences of a report are in ``words``, ``candidate_words`` and ``plan_words``: a terminal says the same.
"""

from onlinebayes.criticism.report import candidate_words, plan_words, words
from onlinebayes.criticism.report.first_screen import first_screen
from onlinebayes.criticism.report.picture import write_picture
from onlinebayes.criticism.report.plan import FILES as PLAN_FILES
from onlinebayes.criticism.report.plan import write_plan
from onlinebayes.criticism.report.refined import FILES as REFINED_FILES
from onlinebayes.criticism.report.refined import left_out, noted
from onlinebayes.criticism.report.style import stylesheet
from onlinebayes.criticism.report.svg import Curve, Panel, chart
from onlinebayes.criticism.report.write import FILES as REPORT_FILES
from onlinebayes.criticism.report.write import write_report

__all__ = [
    "PLAN_FILES",
    "REFINED_FILES",
    "REPORT_FILES",
    "Curve",
    "Panel",
    "candidate_words",
    "chart",
    "first_screen",
    "left_out",
    "noted",
    "plan_words",
    "stylesheet",
    "words",
    "write_picture",
    "write_plan",
    "write_report",
]
