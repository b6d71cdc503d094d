% Runs the functions of tools/matlab_export: arguments are the .mat file and the logs it was made of.
args = argv();
if any(strcmp('gnuplot', available_graphics_toolkits()))
  warning('off', 'Octave:gnuplot-toolkit');
  graphics_toolkit('gnuplot');
end
set(0, 'defaultfigurevisible', 'off');
try
  axes('parent', figure('visible', 'off'));
  close('all');
  draws = true;
catch
  disp('drawing is skipped: this Octave has no font (fonts-freefont-otf)');
  draws = false;
end

runs = mk_load(args{1});
logs = args(2:end);
assert(numel(runs) == numel(logs));
for k = 1:numel(logs)
  direct = mk_load(logs{k});
  assert(isequal(runs(k).name, direct.name));
  assert(runs(k).rig, direct.rig);
  assert(runs(k).time, direct.time, 1e-12);
  assert(runs(k).Y_names, direct.Y_names);
  assert(runs(k).Y_units, direct.Y_units);
  assert(runs(k).Y, direct.Y, -1e-12); % textscan's last digit
  assert(runs(k).signals.q1, direct.signals.q1, -1e-12);
  assert(isequal(runs(k).gains(:), direct.gains(:)));
  assert(isequal(runs(k).parameters, direct.parameters));

  u = mk_inputs(direct);
  assert(size(u), [numel(direct.time), 2]);
  assert(~any(isnan(u(:))));

  % A run against itself is without error; against itself shifted, off by the shift.
  same = mk_compare(direct, direct, 'draw', false);
  assert(same.rms, zeros(size(same.rms)));
  moved = direct;
  moved.signals.q1 = moved.signals.q1 + 0.125;
  off = mk_compare(direct, moved, 'visible', 'off', 'draw', draws);
  assert(off.rms(1), 0.125, 1e-12);
  if ~draws
    continue
  end

  figure_handle = mk_plot(direct, 'visible', 'off');
  assert(ishghandle(figure_handle));
  close('all');

  short = direct;
  keep = short.time - short.time(1) < 0.2;
  short.time = short.time(keep);
  for name = fieldnames(short.signals)'
    short.signals.(name{1}) = short.signals.(name{1})(keep);
  end
  if isempty(short.rig)
    short.rig = 'pendubot';
  end
  frame = mk_animate(short, 'visible', 'off', 'rate', 10);
  assert(all(isfinite(frame(:))));
  if strcmp(short.rig, 'pendubot') % hangs: the tip is two links below the pivot
    assert(frame(:, end), [0; -2], 0.2);
  end
  close('all');
end

% What was exported in other units is the same run: args{1} with deg.mat for .mat.
other = mk_load(strrep(args{1}, '.mat', '_deg.mat'));
assert(other.units.q1, 'deg');
assert(other.units.u, 'mNm');
assert(mk_inputs(other), mk_inputs(runs(1)), 1e-9);
mixed = mk_compare(runs(1), other, 'draw', false);
assert(mixed.rms, zeros(size(mixed.rms)), 1e-9);
mixed = mk_compare(other, runs(1), 'draw', false);
assert(mixed.nrmse, zeros(size(mixed.nrmse)), 1e-9);

if draws
  close(mk_plot(runs([1 1]), 'visible', 'off'));
end
disp('all functions ran');
