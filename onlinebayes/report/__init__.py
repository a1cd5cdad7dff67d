"""The result of criticism as files: report.json, report.html, run.rrd; refined.toml and refined.xml; a picture.

The sentences of a report are in ``words``, ``candidate_words`` and ``plan_words``: a terminal says the same.
"""

from onlinebayes.report import candidate_words, check_words, plan_words, words
from onlinebayes.report.check import FILES as CHECK_FILES
from onlinebayes.report.check import write_check
from onlinebayes.report.model_files import left_out, lost
from onlinebayes.report.picture import write_picture
from onlinebayes.report.plan import FILES as PLAN_FILES
from onlinebayes.report.plan import write_plan
from onlinebayes.report.posterior_page import NAME as POSTERIOR_PAGE
from onlinebayes.report.posterior_page import write_posterior_page
from onlinebayes.report.refined import FILES as REFINED_FILES
from onlinebayes.report.refined import noted
from onlinebayes.report.screen_lines import first_screen
from onlinebayes.report.style import stylesheet
from onlinebayes.report.svg import Curve, Panel, chart
from onlinebayes.report.write import FILES as REPORT_FILES
from onlinebayes.report.write import NEXT_UNIT, write_report

__all__ = [
    "CHECK_FILES",
    "NEXT_UNIT",
    "PLAN_FILES",
    "POSTERIOR_PAGE",
    "REFINED_FILES",
    "REPORT_FILES",
    "Curve",
    "Panel",
    "candidate_words",
    "chart",
    "check_words",
    "first_screen",
    "left_out",
    "lost",
    "noted",
    "plan_words",
    "stylesheet",
    "words",
    "write_check",
    "write_picture",
    "write_plan",
    "write_posterior_page",
    "write_report",
]
