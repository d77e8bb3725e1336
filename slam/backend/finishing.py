"""The map of a drive: all loops once more from where the poses are now, and all poses adjusted to the
end."""

from __future__ import annotations

from dataclasses import replace

from slam.arrays import FloatArray
from slam.backend.drive import Drive
from slam.backend.joint_adjustment import jointly_adjusted
from slam.frontend.keyframes import FrontEndSteps, Keyframe
from slam.frontend.loose_runs import smoothed
from slam.loop_closing import Loop, LoopCloser
from slam.map_checks.jumped_scans import with_jumped_put_back
from slam.map_checks.map_consistency import acquitted, judged
from slam.map_checks.stray_scans import with_scans_put_back
from slam.map_checks.wheels_borne_out import shown_noise
from slam.slam_map import SlamMap, graph_of


def held_together(drive: Drive) -> SlamMap:
    """The map with all loops, and with laxer ones if those make it hold together better.

    Where it is doubtful whether it does, loops may be missing: each keyframe is asked, and less
    complete matches will do. A map that had failed is not acquitted by such loops alone.
    """
    config, graph = drive.config, drive.graph
    slam_map = again = _finished(drive, drive.closer, config.loops.every)
    first = slam_map.verdict
    is_sound = first.is_good and first.bad_pairs <= config.consistency.doubtful_pairs
    if is_sound or not graph.loops or not drive.session.is_joined:
        return slam_map
    before = list(graph.loops), graph.poses.copy()
    loops = replace(config.loops, least_inlier_ratio=config.patient_inlier_ratio)
    closer = LoopCloser(loops, config.front_end.surfaces)
    closer.doubted = drive.closer.doubted
    for _ in range(config.patient_rounds):
        again = _finished(drive, closer, 1)
    if again.verdict.doubt < first.doubt:
        if first.is_good:
            return again
        told = again.keyframes, again.loops, again.rejected
        return replace(again, verdict=acquitted(again.verdict, *told, config.consistency))
    graph.renew(graph.keyframes, *before)
    return slam_map


def _finished(drive: Drive, closer: LoopCloser, every: int) -> SlamMap:
    """The map with the loops that a closer finds beside those known, at every so many keyframes."""
    config, session = drive.config, drive.session
    kept, rejected = _sorted_loops(drive, closer, every)
    keyframes, poses = list(drive.graph.keyframes), drive.graph.poses
    if session.is_joined:
        poses = jointly_adjusted(
            keyframes, kept, poses, config.adjustment, config.front_end.surfaces
        )
    else:
        poses = session.kept_apart(poses)
    poses = session.set_beside(keyframes, poses)
    verdict = judged(keyframes, poses, kept, rejected, config.consistency)
    verdict = verdict.with_reasons(session.objections(keyframes, drive.steps))
    graph = graph_of(keyframes, (*kept, *rejected), poses, config.step_sigma)
    steps = _placed(drive, keyframes, poses)
    return SlamMap(
        tuple(keyframes), poses, tuple(kept), tuple(rejected), graph, steps.close(), verdict,
    )  # fmt: skip


def _sorted_loops(drive: Drive, closer: LoopCloser, every: int) -> tuple[list[Loop], list[Loop]]:
    """Loops kept, and those that others contradict; a session that its scans show to lie elsewhere is
    taken off the map."""
    graph, session = drive.graph, drive.session
    if not graph.loops and not closer.doubted:
        return graph.loops, []
    kept, rejected = _adjusted(drive, closer, every)  # all of them may have been let go
    if session.holds():
        return kept, rejected
    session.unjoin()
    drive.breaks.leave_apart(session.first)
    return _adjusted(drive, closer, every) if graph.loops else ([], [])


def _adjusted(drive: Drive, closer: LoopCloser, every: int) -> tuple[list[Loop], list[Loop]]:
    """Loops kept and rejected once all are found that there are, and all poses adjusted."""
    graph = drive.graph
    graph.solve()
    loops = (*graph.loops, *drive.breaks.let_go)
    known = {(loop.earlier, loop.later) for loop in loops}
    # those of the sessions before were asked when these ended
    asked = [k for k in range(len(graph.keyframes)) if k % every == 0]
    asked = [k for k in asked if k >= drive.session.first]
    found = [loop for k in asked for loop in drive.loops_of(k, closer)]
    graph.take([one for one in found if (one.earlier, one.later) not in known])
    if drive.config.is_odometry_doubted:
        return graph.sorted_loops()
    return drive.breaks.sorted_loops(graph, drive.told_to_keyframes)


def _placed(drive: Drive, keyframes: list[Keyframe], poses: FloatArray) -> FrontEndSteps:
    """Every scan, as seen from its keyframe at poses (K, 3), and what was seen in between with it: where
    wheels led from one keyframe to the next, if something drew it aside."""
    front_end, session, config = drive.front_end, drive.session, drive.config
    first_step, is_doubted = session.first_step, config.is_odometry_doubted
    placed = smoothed(drive.steps, front_end.loose_runs.ended, first_step, keyframes, poses)
    told = [one.told for one in keyframes[session.first :]]
    noise = None if is_doubted else shown_noise(keyframes, poses, told, least=0.0)
    steps = with_scans_put_back(
        placed, first_step, drive.told, front_end.wheel_scale, poses, is_doubted, noise
    )
    glances = dict(enumerate(front_end.glances, start=session.first))
    steps = with_jumped_put_back(
        steps, first_step, drive.told, keyframes, poses,
        {k: since.kept for k, since in glances.items()}, config.front_end.surfaces, config.strays,
    )  # fmt: skip
    strayed = {
        one.T_keyframe_base
        for one, other in zip(placed, steps, strict=True)
        if one.T_keyframe_base != other.T_keyframe_base
    }
    for k, since in glances.items():
        if not keyframes[k].is_place_alone:
            keyframes[k] = replace(keyframes[k], glances=since.kept_but(strayed))
    return steps
