"""Fields of the JSON files of commands: names, types, units and sentences, for their page in the documentation."""

from sim.drive.result import FIGURES, Column, columns

_TASK = columns("""
scene        string  -         name of the scene
robot        string  -         name of the robot
margin       number  m         that plans keep around the robot
footprint    list    m         corners, x ahead and y to the left; not of a disc
risk         number  1         `--risk`, or null
""")
_SAMPLING = columns("""
method       string  -         `--method`
seed         integer 1         of tree, samples and plant noise
noise        number  b         `--noise`, in the unit of the robot
lambda       number  cost      temperature
samples      integer 1         around each reference
dt           number  s         rollout step
period       number  s         control period
""")
_CLASSES = columns("""
classes              list    -       cheapest path of each class, cheapest first
classes[].id         string  -       name of the class; weights are listed by it
classes[].winding    list    turns   whole turns about `obstacles`, then `movers`, against the straight path
classes[].signature  list    turns   H of the paper, its 1 included
classes[].cost       number  cost    of the path, without noise
classes[].length     number  m       of the path
classes[].bodies     list    -       how it passes the obstacles by which classes differ; only where some move
classes[].way        string  -       what it goes through, over, under or past; only in space
obstacles            list    -       static obstacles that paths can turn about
obstacles[].name     string  -       by which sentences call it: of a geom, a body, or `obstacle` and its number
obstacles[].marker   list    m       x, y of a point inside
obstacles[].geoms    list    -       names of its geoms
movers               list    -       names of moving obstacles, a name for each part that paths can turn about
""")
_RISK = columns("""
collision_probability                 object  -     predicted at the start; null if it is not
collision_probability.probability     number  1     until the goal
collision_probability.error           number  1     its standard error
collision_probability.accepted        number  1     part of it that a finite `--phi` accepts
collision_probability.held            number  1     part of it that holding the control adds
collision_probability.classes         object  1     by class, given the class; only of those whose samples have weight
collision_probability.accepted_most   number  1     bound of the accepted part
collision_probability.goal_value      number  cost  v of the samples that arrive
""")

PLAN = (
    *_TASK,
    *columns("""
vertices                   integer 1   of the tree
nodes                      integer 1   of the tree: a vertex has one for each of its classes
pruned_classes             integer 1   classes that --classes left out
seconds                    number  s   wall time of tree and references, without compiling
fcl_calls                  integer 1   collision queries
passages.open              integer 1   passages that are wide enough
passages.unused            list    -   those on no path, narrowest first
passages.unused[].at       list    m   x, y
passages.unused[].width    number  m   of the passage
passages.unused[].between  list    -   names of what is on both sides
convergence.iterations     list    1   with --convergence: random states drawn so far, at each note
convergence.vertices       list    1   of the tree then
convergence.lengths        object  m   least length then, by class
"""),
    *_RISK,
    *_CLASSES,
)
RUN = (
    *_TASK,
    *_SAMPLING,
    *columns("""
phi                             number  cost  final cost off the goal; null if infinite
grow                            integer 1     vertices that the tree gains per period; null: as there is time
predict                         string  -     `--predict`; only where obstacles move
sense                           string  -     `--sense`, `--lidar` and what follows; only where it is lidar
lidar                           string  -     what differs from the default one, or null
sense_pose                      number  m     `--sense-pose`
cell                            number  m     `--cell`
unknown                         number  cost  `--unknown`
"""),
    *FIGURES,
    *columns("""
step_ms.median                  number  ms    wall time of a plan
step_ms.p95                     number  ms    its 95th percentile
step_ms.max                     number  ms    the longest
map_ms                          object  ms    from scans to a map that is planned in: median, p99 and max; of a lidar
deadline_misses                 integer 1     plans that took longer than the period, or by a clock were late
blocked                         list    s     from when to when no path was found or no sample survived
plant_mismatch                  object  1     by state: rms off the equation after a period; of wheels and rotors
real_time.period                number  s     with --real-time: control period
real_time.periods               integer 1     control periods
real_time.deadline_misses       integer 1     as above
real_time.samples_per_period    object  1     median and min
real_time.slack_ms              object  ms    between the end of a plan and its deadline: median and min
real_time.late_ms               object  ms    by which physics steps were late: median, p99 and max
truth.value                     number  cost  with --truth: exact v at the start
truth.mean_control_error        number  u     distance of the control from the optimal one, on average
truth.max_control_error         number  u     at most
dropped_frames                  integer 1     control steps that did not reach a viewer; only with one
events                          list    -     of `play`: what was done to the robot and its world
"""),
    *_RISK,
    *_CLASSES,
)
ESTIMATE = (
    *columns("""
value                       list    cost  estimate of v
value_stderr                list    cost  its standard error
control                     list    u     estimate of the optimal control
control_stderr              list    u     its standard errors
ess                         list    1     effective samples
doubtful                    list    -     whether they are so few that standard errors mean little
tail                        list    1     shape of the tail of the weights; null if too few have any
samples                     list    1     that were drawn
class_weights               list    1     share of psi by class, and of all other classes as `other`
class_weights_stderr        list    1     their standard errors; null for a class that no sample took
class_ess                   list    1     effective samples by class
proposal_weights            list    1     weight of the samples drawn around each reference
truth.value                 number  cost  with --truth: exact v
truth.control               list    u     optimal control
truth.class_weights         object  1     exact share of psi by class
truth.class_weights_stderr  object  1     their standard errors, since optimal paths are drawn for them
value_error                 list    cost  with --truth: estimate less exact value
control_error               list    u     with --truth: distance of the control from the optimal one
collision_probability       list    -     predicted, with the fields that it has in other files
"""),
    *_CLASSES,
)
SWEEP = (
    *columns("""
scene            string  -     name of the scene
scene_digest     string  -     of the content of the files of scene and robot
robot            string  -     name of the robot
plan_seed        integer 1     of the tree
"""),
    *_SAMPLING,
    *FIGURES,
    *columns("""
step_ms          object  ms    wall time of a plan: median, p95 and max
deadline_misses  integer 1     plans that took longer than the period
blocked          list    s     as of `run`; only of runs that this command drove
shortest_length  number  m     shortest reference at the start; null for methods without a tree
plan_seconds     number  s     wall time of tree and references without compiling; the runs of a scene share it
drive_seconds    number  s     wall time of the run without compiling
error            string  -     why the run did not come to an end, null if it did
"""),
)
FILES: dict[str, tuple[Column, ...]] = {"plan": PLAN, "run": RUN, "estimate": ESTIMATE, "sweep": SWEEP}
