"""Pictures of what training and evaluation wrote.

``python -m fauna.plots RUN [RUN ...] --out curves.png`` draws losses and metrics over the steps,
``python -m fauna.plots.gallery REPORT --out FOLDER`` draws predictions. :mod:`fauna.plots.bank` draws what a bank has
learned (``fauna-bank species``), :mod:`fauna.plots.bodies` small pictures of bodies.
"""
