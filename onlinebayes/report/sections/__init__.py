"""The parts of report.html, one module each: a function from the result to HTML, empty with nothing to say."""
