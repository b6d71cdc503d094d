% An exported model against `mechkit simulate --states`: arguments are the function file, the log
% that drove it, the prediction, and the model file.
args = argv();
model = mk_model(args{1});
log = mk_load(args{2});
wanted = mk_load(args{3});
states = wanted.Y(:, strncmp(wanted.Y_names, 'x', 1));
run = mk_simulate(model, log.time, mk_inputs(log), states(1, :)', 1e-10);
for j = 1:model.joints
  name = sprintf('q%d', j);
  assert(run.signals.(name), wanted.signals.(name), 1e-6);
end
figures = mk_compare(wanted, run, 'draw', false);
assert(all(figures.worst < 1e-6));

% The mass matrix turns missing acceleration into missing torque: what the model explains misses none.
[dx, y, mass] = model.f(0, states(1, :)', [0; 0]);
assert(size(dx), [numel(model.state_names), 1]);
assert(size(mass), [model.joints, model.joints]);
assert(min(eig(mass)) > 0);

% ode45 takes it as it is.
[t, x] = ode45(model.ode(@(t) 1.5 * sin(6 * t)), [0, 0.05], model.state(model.rest, 0));
assert(all(isfinite(x(:))));

% The program makes the function by itself where it is given a model file.
same = mk_model(args{4});
x = states(end, :)';
assert(same.f(1, x, [0.5; 0]), model.f(1, x, [0.5; 0]));
assert(same.p, model.p);

% What the model lacks, drawn from its own prediction: next to nothing.
if any(strcmp('gnuplot', available_graphics_toolkits()))
  warning('off', 'Octave:gnuplot-toolkit');
  graphics_toolkit('gnuplot');
end
try
  axes('parent', figure('visible', 'off'));
  draws = true;
catch
  disp('drawing is skipped: this Octave has no font (fonts-freefont-otf)');
  draws = false;
end
if draws
  figure_handle = mk_plot(log, 'model', model, 'visible', 'off');
  assert(ishghandle(figure_handle));
  panels = findobj(figure_handle, 'type', 'axes');
  assert(any(strcmp('residual torque', arrayfun(@(a) get(get(a, 'ylabel'), 'string'), panels, 'uniformoutput', false))));
  close('all');
end
disp('the model agrees');
