# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motion of a point's scene, and the beam of it as the analysis takes it."""

from atpid_sim.scene import Scene
from atpid_sim.simulation.simulate import Trajectory, trajectory
from studies.theory.energy import BeamMotion, Structure

#: Samples a second from which energies and forces are read: an impact of 0.7 ms has 35.
FINE = 50_000.0


def structure_of(scene: Scene) -> Structure:
    """Return the beam of a scene."""
    beam = scene.beam
    return Structure(beam.mass, beam.stiffness, beam.damping, scene.gravity, -scene.static_deflection)


def beam_of(motion: Trajectory) -> BeamMotion:
    """Return the beam's part of a motion."""
    return BeamMotion(motion.time, motion.support, motion.beam, motion.beam_velocity, motion.beam_acceleration)


def soft(scene: Scene, rate: float) -> Trajectory:
    """Return the motion of a scene at `rate` [Hz] with nothing left out of the contacts."""
    return trajectory(scene, rate, "impact" if scene.contact.law == "impact" else "soft")
