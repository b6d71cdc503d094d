function u = mk_inputs(run)
%MK_INPUTS  The command of a run as the models take it: N x 2, the second column the torque on
%   joint 2 of a rig with two motors (else 0). A value that is missing is held from before.
  s = run.signals;
  zero = zeros(numel(run.time), 1);
  if isfield(s, 'u1')
    u = [s.u1, pick(s, 'u2', zero)];
  elseif isfield(s, 'tau1')
    u = [s.tau1, pick(s, 'tau2', zero)];
  elseif isfield(s, 'u')
    u = [s.u, zero];
  else
    u = [s.tau, zero];
  end
  u(1, isnan(u(1, :))) = 0;
  for k = find(any(isnan(u), 2))'
    u(k, isnan(u(k, :))) = u(k - 1, isnan(u(k, :)));
  end
end

function column = pick(s, name, missing)
  column = missing;
  if isfield(s, name)
    column = s.(name);
  end
end
