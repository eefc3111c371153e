"""Plans of little effort, and a study of them: what does not depend on how good a plan is, is tested with these."""

from __future__ import annotations

from planner.search.search import Effort
from planner.study.draws import Study, usual_model

QUICK = Effort(starts=3, strokes=6, best=2, rounds=1, halved=1, plays=8, finalists=2, closely=16, fresh=16)
STUDY = Study(usual_model(), method="risk", plays=8, effort=QUICK)
