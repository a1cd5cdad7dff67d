"""Files that measurements come in, each as columns by name: CSV, Parquet, MCAP, ROS 2 bags, ULog, LeRobot, Rerun."""

from onlinebayes.measurements.formats.opening import open_source
from onlinebayes.measurements.formats.source import Columns, Source

__all__ = ["Columns", "Source", "open_source"]
