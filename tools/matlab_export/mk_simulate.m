function run = mk_simulate(model, time, u, x0, tolerance)
%MK_SIMULATE  Drive a model by a sampled command, as `mechkit simulate` does.
%   R = MK_SIMULATE(M, TIME, U, X0)   M from MK_MODEL; U (N x 1 or N x 2) is held from each instant
%   of TIME to the next; X0 the state at TIME(1), from M.state(q, v). R looks like a run of MK_LOAD.
%   MK_SIMULATE(..., TOLERANCE)       relative; default 1e-9
  if nargin < 5
    tolerance = 1e-9;
  end
  time = time(:);
  if size(u, 2) == 1
    u(:, 2) = 0;
  end
  n = numel(time);
  x = zeros(numel(x0), n);
  x(:, 1) = x0(:);
  h = 0;
  zero = time(1);
  for k = 1:(n - 1)
    edges = edges_between(model.command_delay, time, k);
    x(:, k + 1) = x(:, k);
    for e = 1:(numel(edges) - 1)
      now_u = u(held_row(time, edges(e) - model.command_delay), :)';
      if edges(e) - model.command_delay < time(1) - 1e-12
        now_u = [0; 0]; % before the log nothing was commanded
      end
      [x(:, k + 1), h] = advance(model.f, edges(e) - zero, edges(e + 1) - zero, x(:, k + 1), ...
                                 now_u, tolerance, h);
    end
  end
  run = collect(model, time, u, x);
end

function edges = edges_between(delay, time, k)
  % The command that acts changes where a delayed sample arrives.
  arrivals = time + delay;
  inside = arrivals(arrivals > time(k) + 1e-12 & arrivals < time(k + 1) - 1e-12);
  edges = [time(k); inside(:); time(k + 1)];
end

function row = held_row(time, t)
  row = max(1, find(time <= t + 1e-12, 1, 'last'));
  if isempty(row)
    row = 1;
  end
end

function [x, h] = advance(f, t, last, x, u, tolerance, h)
  % Dormand and Prince 5(4) with error control; h is carried on from call to call.
  if h <= 0
    h = (last - t) / 4;
  end
  while t < last - 1e-13 * max(1, abs(last))
    step = min(h, last - t);
    k1 = f(t, x, u);
    k2 = f(t + step / 5, x + step * k1 / 5, u);
    k3 = f(t + 0.3 * step, x + step * (3 * k1 + 9 * k2) / 40, u);
    k4 = f(t + 0.8 * step, x + step * (44 / 45 * k1 - 56 / 15 * k2 + 32 / 9 * k3), u);
    k5 = f(t + 8 / 9 * step, x + step * (19372 / 6561 * k1 - 25360 / 2187 * k2 + ...
           64448 / 6561 * k3 - 212 / 729 * k4), u);
    k6 = f(t + step, x + step * (9017 / 3168 * k1 - 355 / 33 * k2 + 46732 / 5247 * k3 + ...
           49 / 176 * k4 - 5103 / 18656 * k5), u);
    next = x + step * (35 / 384 * k1 + 500 / 1113 * k3 + 125 / 192 * k4 - 2187 / 6784 * k5 + ...
           11 / 84 * k6);
    k7 = f(t + step, next, u);
    e = step * (71 / 57600 * k1 - 71 / 16695 * k3 + 71 / 1920 * k4 - 17253 / 339200 * k5 + ...
        22 / 525 * k6 - k7 / 40);
    worst = max(abs(e) ./ (tolerance * (0.01 + max(abs(x), abs(next)))));
    if worst <= 1
      t = t + step;
      x = next;
    elseif step < 1e-12
      error('mk_simulate:step', 'the model cannot be followed at t = %g', t);
    end
    factor = min(5, max(0.2, 0.9 * max(worst, 1e-10) ^ -0.2));
    if worst > 1 || step == h || factor < 1
      h = step * factor;
    end
  end
end

function run = collect(model, time, u, x)
  n = model.joints;
  run = struct('name', 'simulated', 'rig', model.rig, 'time', time);
  zero = time(1);
  y = zeros(n, numel(time));
  for k = 1:numel(time)
    [~, y(:, k)] = model.f(time(k) - zero, x(:, k), u(k, :)');
  end
  names = {'t'};
  run.Y = time;
  for j = 1:n
    if model.sensor_delay(j) > 0
      y(j, :) = interp1(time, y(j, :), max(time(1), time - model.sensor_delay(j)), 'pchip');
    end
    run.signals.(sprintf('q%d', j)) = y(j, :)';
    run.units.(sprintf('q%d', j)) = 'rad';
    run.signals.(sprintf('dq%d', j)) = x(n + j, :)';
    run.units.(sprintf('dq%d', j)) = 'rad/s';
    run.Y = [run.Y, y(j, :)', x(n + j, :)'];
    names = [names, {sprintf('q%d', j), sprintf('dq%d', j)}]; %#ok<AGROW>
  end
  run.signals.u = u(:, 1);
  run.units.u = '';
  run.Y_names = names;
  run.states = x';
end
