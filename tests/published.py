"""The tables of Huynh et al. 2021 and Do, Vu, Liu 2022 as printed, and what an independent recomputation of them gave.

What a paper computes has `printed` in its name. The same without `printed` comes
from a numpy program that shares nothing with Armonic (finite-difference kinematics, LAPACK eigenvalues): it
agrees with the print and carries more digits.
"""

from __future__ import annotations

from dataclasses import dataclass

Row = tuple[float, ...]


@dataclass(frozen=True)
class Body:
    """One column of an inertia table; `products` are xy, xz, yz as printed: minus the tensor entries."""

    mass: float
    com: Row
    moments: Row
    products: Row

    @property
    def tensor(self) -> tuple[Row, Row, Row]:
        (xx, yy, zz), (xy, xz, yz) = self.moments, self.products
        return (xx, -xy, -xz), (-xy, yy, -yz), (-xz, -yz, zz)


@dataclass(frozen=True)
class ModalTable:
    """Damped natural frequencies, Im(lambda) / 2 pi, and damping ratios."""

    damped_freq_hz: Row
    damping_ratio: Row


@dataclass(frozen=True)
class Huynh3R:
    """The three-axis example of section 4."""

    links: tuple[str, ...] = ("carousel", "link_arm", "arm")
    a1: float = 0.35
    a2: float = 1.35
    sensor_offset: Row = (1.566, 0.042, 0.005)
    gravity: Row = (0.0, 0.0, -9.81)
    bodies: tuple[Body, ...] = (
        Body(511.726, (-0.018, 0.002, -0.21), (19.45, 33.893, 30.242), (2.274, 0.938, 0.373)),
        Body(249.53, (0.532, -0.007, 0.248), (5.014, 57.621, 56.853), (-1.058, 5.498, -0.069)),
        Body(222.659, (0.423, 0.018, -0.018), (5.882, 49.927, 48.9), (-1.372, 0.074, -1.202)),
    )
    posture_deg: Row = (0.0, 70.0, -100.0)
    stiffness: Row = (2.0e6, 3.0e6, 1.55e6)
    damping: Row = (1200.0, 1545.0, 340.0)

    printed_mass_matrix: tuple[Row, ...] = ((482.1, -30.5, 0.3), (-30.5, 588.8, 72.1), (0.3, 72.1, 88.7))
    printed_gravity_stiffness_23: float = 427.816
    printed_modes: ModalTable = ModalTable((10.17, 11.24, 22.6), (0.0189, 0.018, 0.0166))

    mass_matrix: tuple[Row, ...] = ((481.52, -30.55, 0.29), (-30.55, 588.59, 72.06), (0.29, 72.06, 88.81))
    gravity_stiffness: tuple[Row, ...] = (
        (0.0, 0.0, 0.0),
        (0.0, -3560.904, 427.927),
        (0.0, 427.927, 427.927),
    )
    modes: ModalTable = ModalTable((10.178, 11.241, 22.589), (0.01894, 0.01796, 0.01662))
    natural_freq_hz: Row = (10.180, 11.243, 22.592)


@dataclass(frozen=True)
class Elasticity:
    """One column pair of Table 5 in its units, in the order z1 x1 y1 z2 x2 y2 z3 x3 y3."""

    stiffness_mega: Row
    damping_kilo: Row

    @property
    def stiffness(self) -> Row:
        """N m/rad."""
        return tuple(k * 1e6 for k in self.stiffness_mega)

    @property
    def damping(self) -> Row:
        """N m s/rad."""
        return tuple(d * 1e3 for d in self.damping_kilo)


@dataclass(frozen=True)
class KukaKr90:
    """The milling robot of section 5: every joint turns about z on a spring, then about virtual x and y."""

    links: tuple[str, ...] = ("carousel", "link_arm", "arm")
    keys: tuple[str, ...] = ("z", "x", "y")
    a1: float = 0.35
    a2: float = 1.35
    sensor_offset: Row = (1.566, 0.042, 0.005)
    gravity: Row = (0.0, 0.0, -9.81)
    bodies: tuple[Body, ...] = (
        Body(511.726, (-0.02, 0.0, -0.21), (15.45, 30.90, 30.24), (1.87, 0.94, 0.37)),
        Body(249.53, (0.53, 0.0, 0.25), (80.01, 150.62, 150.85), (-1.06, 0.5, -0.07)),
        Body(222.659, (0.42, 0.02, -0.02), (45.88, 125.93, 125.90), (-1.37, 0.07, -1.20)),
    )
    posture_deg: Row = (0.0, 70.0, -100.0)

    # Table 5. The first pair is the column "From [34]".
    earlier_work: Elasticity = Elasticity(
        (5.0, 6.1, 11.9, 6.9, 11.8, 8.1, 2.8, 5.2, 12.0), (0.02, 0.04, 3.1, 2.4, 0.04, 9.4, 0.2, 9.2, 0.08)
    )
    fit_modelled: Elasticity = Elasticity(
        (5.0, 5.4, 15.4, 5.9, 11.3, 9.0, 2.8, 18.2, 23.3), (0.03, 0.6, 0.3, 2.6, 0.2, 10.0, 0.2, 4.1, 0.7)
    )
    fit_measured: Elasticity = Elasticity(
        (5.0, 5.8, 10.0, 8.0, 9.5, 32.0, 2.8, 100.0, 100.0),
        (0.12, 0.02, 0.006, 9.16, 0.01, 4.0, 0.03, 2.6, 9.0),
    )
    fit_synthesized: Elasticity = Elasticity(
        (3.5, 7.0, 11.9, 6.9, 22.6, 18.2, 2.7, 0.9, 21.01),
        (1.5, 0.001, 7.3, 0.4, 0.002, 0.3, 0.3, 0.08, 0.06),
    )

    # Table 4: initial values and bounds of every fit, partly reconstructed.
    start: Elasticity = Elasticity((3, 4, 8, 4, 8, 4, 1, 5, 5), (0.1,) * 9)
    stiffness_bounds: tuple[Row, Row] = ((5.5e5,) * 9, (5e6, 5e7, 5e7, 8e6, 4e7, 4e7, 4e6, 1e8, 1e8))
    damping_bounds: tuple[float, float] = (1.0, 1.0e4)

    measured_modes: ModalTable = ModalTable((10.0, 11.0, 19.2, 23.7), (0.014, 0.010, 0.005, 0.008))

    # Table 6, and the same recomputed from the rounded parameters of Table 5.
    printed_modes_earlier_work: ModalTable = ModalTable((10.0, 11.1, 18.7, 23.8), (0.011, 0.010, 0.006, 0.008))
    printed_modes_fit_modelled: ModalTable = ModalTable((10.0, 11.1, 18.7, 23.8), (0.010, 0.010, 0.006, 0.008))
    printed_modes_fit_measured: ModalTable = ModalTable((11.0, 11.2, 19.5, 24.0), (0.016, 0.003, 0.001, 0.005))
    printed_modes_fit_synthesized: ModalTable = ModalTable((10.0, 11.1, 19.5, 23.6), (0.009, 0.010, 0.007, 0.008))
    modes_earlier_work: ModalTable = ModalTable((9.96, 11.07, 18.72, 23.85), (0.0108, 0.0101, 0.0059, 0.0070))
    modes_fit_modelled: ModalTable = ModalTable((9.96, 11.09, 18.71, 23.83), (0.0104, 0.0097, 0.0063, 0.0071))
    modes_fit_measured: ModalTable = ModalTable((11.02, 11.19, 19.46, 23.90), (0.0155, 0.0026, 0.0008, 0.0048))
    modes_fit_synthesized: ModalTable = ModalTable((10.01, 11.06, 19.52, 23.48), (0.0088, 0.0098, 0.0070, 0.0093))
    # A fifth mode lies in the band here.
    fifth_damped_freq_hz_fit_synthesized: float = 24.27
    # The nine modes of the earlier work's parameters; only four lie in the measured band.
    all_damped_freq_hz_earlier_work: Row = (9.96, 11.07, 18.72, 23.85, 53.05, 69.39, 71.62, 95.61, 111.86)


@dataclass(frozen=True)
class ClosedLoopTable:
    """Undamped natural frequencies, abs(lambda) / 2 pi, and damping ratios, of twelve modes."""

    natural_freq_hz: Row
    damping_percent: Row


@dataclass(frozen=True)
class Scompi:
    """Do, Vu, Liu 2022, section 4: the grinding robot bare (case 1) and with 4 kg at its tool (case 2)."""

    tool_mass: tuple[float, float] = (0.0, 4.0)

    # Table 5, analytical columns, at configuration 8 of 50.
    printed_table_5: tuple[ClosedLoopTable, ClosedLoopTable] = (
        ClosedLoopTable(
            (6.3692, 6.9642, 9.8842, 12.7170, 13.1418, 25.5949, 37.0199, 58.3984, 58.8631, 94.3825, 183.2303, 850.8082),
            (7.6686, 11.2981, 12.7399, 16.1988, 16.7181, 26.5926, 1.3938, 2.9817, 3.4643, 2.2483, 17.0471, 80.5774),
        ),
        ClosedLoopTable(
            (5.9634, 6.6522, 9.2928, 12.6414, 13.1418, 25.3752, 33.1574, 46.3479, 49.3412, 92.0281, 138.7911, 850.5782),
            (7.1538, 10.8175, 11.9109, 16.1256, 16.7181, 25.6469, 2.3513, 2.1881, 3.3381, 2.2052, 12.5831, 80.5557),
        ),
    )
    # Section 4.2, over all configurations and both cases.
    printed_lowest_hz: float = 5.13
    printed_highest_hz: float = 851.14
    printed_damping_percent: Row = (1.25, 80.61)
    # Section 4.2 on Fig. 5: configuration 1, first mode, K_P from 2000 to 15 000 with K_D = 0.425 sqrt(K_P).
    printed_sweep_kp: Row = (2000.0, 15000.0)
    printed_sweep_freq_hz: Row = (2.39, 6.51)
    printed_sweep_damping_percent: Row = (9.44, 7.85)
    # Eqs. 21 and 22.
    printed_q: Row = (0.0, -0.374, 1.9448, 0.0, -1.9448, 0.0)
    printed_motor_position: Row = (0.0, -0.374, 1.9446, -0.0001, -1.9449, 0.0)


HUYNH_3R = Huynh3R()
SCOMPI = Scompi()
KUKA_KR90 = KukaKr90()
