"""Does a balloon stay a sphere? Finite elements and a closed form that say so without the simulator.

`elements` is an axisymmetric membrane of any strain energy w(λ₁, λ₂) in its plane. Its energy is written
down; the derivatives come from automatic differentiation (`jets`), and none of them was taken by hand.
`modes` reads from the second variation about a sphere the eigenvalues of each degree n of the spherical
harmonics; `torsion` has the shear within the surface. `closed_form` has the same numbers as formulas,
derived in docs/shape.md. `pair` finds in 40 digits where the two balloons of Sun, Wang & Zhou lose the
sphere. `pear` follows the pear-shaped equilibria that branch off there, a little way.
"""
