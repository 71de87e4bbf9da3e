"""The verbs of the command line as functions: open data, run, write what came out."""

from __future__ import annotations

from depthprint.runs.classify import NearClass, run_classify
from depthprint.runs.demo import run_demo
from depthprint.runs.encode import EncodedSequence, run_encode
from depthprint.runs.evaluate import run_evaluate_loops
from depthprint.runs.evaluate_objects import ObjectQueries, run_evaluate_objects
from depthprint.runs.explain import ExplainedStream, Explanation, run_explain
from depthprint.runs.found_loops import FoundLoops
from depthprint.runs.info import describe_file, describe_installation
from depthprint.runs.localise import run_map_localise
from depthprint.runs.loops import run_loops
from depthprint.runs.maps import MapSummary, run_map_build, run_map_info, run_map_merge
from depthprint.runs.simulate import SimulatedRecording, run_simulate
from depthprint.runs.source import DataSource
from depthprint.runs.stages import ProgressCallback, RunSummary, Stages, silent
from depthprint.runs.threshold import background_threshold
from depthprint.runs.train import TrainedModel, run_train
from depthprint.runs.train_objects import TrainedObjects, run_recognise, run_train_objects

__all__ = [
    "DataSource",
    "EncodedSequence",
    "ExplainedStream",
    "Explanation",
    "FoundLoops",
    "MapSummary",
    "NearClass",
    "ObjectQueries",
    "ProgressCallback",
    "RunSummary",
    "SimulatedRecording",
    "Stages",
    "TrainedModel",
    "TrainedObjects",
    "background_threshold",
    "describe_file",
    "describe_installation",
    "run_classify",
    "run_demo",
    "run_encode",
    "run_evaluate_loops",
    "run_evaluate_objects",
    "run_explain",
    "run_loops",
    "run_map_build",
    "run_map_info",
    "run_map_localise",
    "run_map_merge",
    "run_recognise",
    "run_simulate",
    "run_train",
    "run_train_objects",
    "silent",
]
