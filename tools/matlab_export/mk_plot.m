function handles = mk_plot(runs, varargin)
%MK_PLOT  Draw runs: angles, command, phase plane, residual torque.
%   MK_PLOT(R)                   R from MK_LOAD; several runs lie over each other
%   MK_PLOT(R, 'model', M)       with M from MK_MODEL: also the torque that the model lacks, i.e.
%                                mass matrix times (measured minus modelled acceleration)
%   MK_PLOT(..., 'visible', 'off')
%   Returns the handle of the figure. Angles that a .mat file has in other units keep them.
  opt = struct('model', [], 'visible', 'on');
  for k = 1:2:numel(varargin)
    opt.(varargin{k}) = varargin{k + 1};
  end
  two = isfield(runs(1).signals, 'q2');
  rows = 2 + two + ~isempty(opt.model);
  handles = figure('visible', opt.visible, 'name', runs(1).name);
  for k = 1:numel(runs)
    r = runs(k);
    for j = 1:(1 + two)
      name = sprintf('q%d', j);
      subplot(rows, 3, 3 * j - [2 1]);
      plot(r.time, r.signals.(name));
      hold on;
      grid on;
      ylabel(sprintf('%s [%s]', name, r.units.(name)));
    end
    subplot(rows, 3, 3 * (2 + two) - [2 1]);
    [u, label] = command(r);
    stairs(r.time, u);
    hold on;
    grid on;
    ylabel(label);
    xlabel('t [s]');
    phase_plane(r, rows, two);
    if ~isempty(opt.model)
      subplot(rows, 3, 3 * rows - [2 1]);
      plot(r.time, missing_torque(r, opt.model));
      hold on;
      grid on;
      ylabel('residual torque');
      joints = {'joint 1', 'joint 2'};
      legend(joints{1:(1 + two)});
      xlabel('t [s]');
    end
  end
  if numel(runs) > 1
    subplot(rows, 3, [1 2]);
    legend({runs.name}, 'interpreter', 'none');
  end
end

function phase_plane(r, rows, two)
  j = 1 + two;
  if strcmp(r.rig, 'reaction-wheel')
    j = 1; % the wheel's angle has no meaning by itself
  end
  q = r.signals.(sprintf('q%d', j));
  subplot(rows, 3, 3:3:(3 * rows));
  plot(q, speed(r, j));
  hold on;
  grid on;
  xlabel(sprintf('q%d [%s]', j, r.units.(sprintf('q%d', j))));
  ylabel(sprintf('dq%d', j));
end

function v = speed(r, j)
  name = sprintf('dq%d', j);
  if isfield(r.signals, name)
    v = r.signals.(name);
  else
    v = gradient(r.signals.(sprintf('q%d', j)), r.time);
  end
end

function [u, label] = command(r)
  names = {'u', 'u1', 'tau', 'tau1'};
  have = names(isfield(r.signals, names));
  u = r.signals.(have{1});
  label = sprintf('%s [%s]', have{1}, r.units.(have{1}));
end

function tau = missing_torque(r, model)
  n = model.joints;
  q = zeros(numel(r.time), n);
  for j = 1:n
    name = sprintf('q%d', j);
    q(:, j) = r.signals.(name) * mk_unit(r.units.(name));
  end
  [q, v, a] = smooth_derivatives(r.time, q);
  u = mk_inputs(r);
  tau = zeros(size(q));
  for k = 1:numel(r.time)
    x = model.state(q(k, :)', v(k, :)');
    if any(isnan(a(k, :)))
      tau(k, :) = NaN;
      continue
    end
    [dx, ~, mass] = model.f(r.time(k) - r.time(1), x, u(k, :)');
    tau(k, :) = (mass * (a(k, :)' - dx(n + (1:n))))';
  end
end

function [s, v, a] = smooth_derivatives(t, q)
  % A cubic through 21 samples around each: what a second difference of counts would say is noise. At
  % the ends, where all of them lie on one side, there is no acceleration.
  half = 10;
  s = q;
  v = zeros(size(q));
  a = nan(size(q));
  for k = (1 + half):(numel(t) - half)
    near = (k - half):(k + half);
    h = max(abs(t(near) - t(k)));
    c = bsxfun(@power, (t(near) - t(k)) / h, 0:3) \ q(near, :);
    s(k, :) = c(1, :);
    v(k, :) = c(2, :) / h;
    a(k, :) = 2 * c(3, :) / h ^ 2;
  end
end
