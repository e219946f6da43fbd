"""Singular values of the closure Jacobian's blocks, which the ranks are read from."""

from __future__ import annotations

from gough import view
from gough.analysis.ranks import EPSILON, Linearisation, Ranks, singular_values
from gough.studies.context import Context
from gough.studies.numbers import written
from gough.studies.report import Paragraph, Section
from gough.view import Spectrum


def section(context: Context) -> Section:
    """One picture of four spectra."""
    rates = context.analysis.rates
    length = context.robot.assembler.length
    if not rates.E.size:
        text = "There are no closure equations, so there are no singular values."
        return Section("singular-values", "Singular values", [Paragraph(text)])
    spectra = _spectra(rates, context.analysis.generic.ranks)
    intro = Paragraph(
        f"All ranks use one threshold, {written(rates.threshold, 2)}: {written(EPSILON)} times "
        "the largest singular value of E. Lengths are divided by the characteristic length, "
        f"{written(length, 4)} m, so that the values have no unit. A wide empty band around "
        "the threshold means that the ranks are beyond doubt."
    )
    figure = view.draw_spectra(spectra, rates.threshold)
    caption = (
        "Singular values at home, largest first. Filled: kept; hollow: dropped as zero; dashed: "
        "the threshold."
    )
    about = "Singular values of E, N, [M N] and [N K] on a logarithmic scale"
    drawn = context.picture("singular-values", figure, caption, about)
    data = {
        "threshold": rates.threshold,
        "unit": "1",
        "values": {spectrum.name: spectrum.values for spectrum in spectra},
    }
    return Section("singular-values", "Singular values", [intro, drawn], {"singular_values": data})


def _spectra(rates: Linearisation, generic: Ranks) -> list[Spectrum]:
    M, N, K = rates.M, rates.N, rates.K
    return [
        Spectrum("E = [M N K]", singular_values(M, N, K), generic.E),
        Spectrum("N", singular_values(N), generic.N),
        Spectrum("[M N]", singular_values(M, N), generic.MN),
        Spectrum("[N K]", singular_values(N, K), generic.NK),
    ]
