"""The equations of motion of the records: what breaks them shows place and kind of a cause, without simulation.

Every set of bodies whose accelerations are measured gives an equation that holds sample by sample, independent of the
rest of the rig: the drive minus the inertia of these bodies is the force of the links and contacts that join them to the others.
A wrong link, sensor or mass breaks exactly the equations that contain it.

`motion` derives the bodies' motion from the sensors, `balances` lists the equations that a description and its sensors support,
`spectral` solves those without dry friction in the frequency domain, `sliding` those with it in the time domain, and `ranking`
tries every kind of cause at every place.
"""
