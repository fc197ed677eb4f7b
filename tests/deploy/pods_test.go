package deploy

import (
	"slices"
	"strconv"
	"strings"
	"testing"

	corev1 "k8s.io/api/core/v1"
)

func TestPodsAreConfined(t *testing.T) {
	eachRelease(t, func(t *testing.T, r *release) {
		for _, w := range r.workloads() {
			pod := w.template.Spec
			security := pod.SecurityContext
			if security == nil || security.RunAsNonRoot == nil || !*security.RunAsNonRoot || security.RunAsUser == nil || *security.RunAsUser == 0 {
				t.Errorf("%s may run as root", w.name)
			}
			if security == nil || security.SeccompProfile == nil || security.SeccompProfile.Type != corev1.SeccompProfileTypeRuntimeDefault {
				t.Errorf("%s has no seccomp profile", w.name)
			}
			if pod.AutomountServiceAccountToken == nil || *pod.AutomountServiceAccountToken {
				t.Errorf("%s gets a token of the cluster", w.name)
			}
			if pod.HostNetwork || pod.HostPID || pod.HostIPC {
				t.Errorf("%s shares namespaces with its node", w.name)
			}
			for _, c := range slices.Concat(pod.InitContainers, pod.Containers) {
				checkConfined(t, w.name, c)
				checkMounts(t, w.name, pod, c)
			}
		}
	})
}

func checkConfined(t *testing.T, name string, c corev1.Container) {
	t.Helper()
	s := c.SecurityContext
	if s == nil || s.ReadOnlyRootFilesystem == nil || !*s.ReadOnlyRootFilesystem {
		t.Errorf("%s may write to its root file system", name)
	}
	if s == nil || s.AllowPrivilegeEscalation == nil || *s.AllowPrivilegeEscalation {
		t.Errorf("%s may gain privileges", name)
	}
	if s == nil || s.Capabilities == nil || !slices.Equal(s.Capabilities.Drop, []corev1.Capability{"ALL"}) || len(s.Capabilities.Add) > 0 {
		t.Errorf("%s keeps capabilities", name)
	}
	if c.Resources.Requests.Memory().IsZero() || c.Resources.Requests.Cpu().IsZero() || c.Resources.Limits.Memory().IsZero() {
		t.Errorf("%s: resources %+v; want requests of both and a limit of memory", name, c.Resources)
	}
	if _, tag, tagged := strings.Cut(c.Image, ":"); !tagged || tag == "" || tag == "latest" {
		t.Errorf("%s: image %q is not pinned", name, c.Image)
	}
}

// checkMounts wants every volume mounted and every mount to have one; secrets are read-only and
// nobody else's.
func checkMounts(t *testing.T, name string, pod corev1.PodSpec, c corev1.Container) {
	t.Helper()
	mounted := map[string]corev1.VolumeMount{}
	for _, m := range c.VolumeMounts {
		mounted[m.Name] = m
	}
	for _, v := range pod.Volumes {
		m, used := mounted[v.Name]
		delete(mounted, v.Name)
		switch {
		case !used:
			t.Errorf("%s: volume %s is not mounted", name, v.Name)
		case v.Secret != nil && !m.ReadOnly:
			t.Errorf("%s may write to secret %s", name, v.Name)
		case v.Secret != nil && (v.Secret.DefaultMode == nil || *v.Secret.DefaultMode&0o007 != 0):
			t.Errorf("%s: others can read secret %s", name, v.Name)
		case v.HostPath != nil:
			t.Errorf("%s mounts %s of its node", name, v.HostPath.Path)
		}
	}
	for volume := range mounted {
		t.Errorf("%s mounts %s, which is no volume", name, volume)
	}
}

func TestProbesAskPortsThatExist(t *testing.T) {
	eachRelease(t, func(t *testing.T, r *release) {
		for _, w := range r.workloads() {
			for _, c := range w.template.Spec.Containers {
				for kind, probe := range map[string]*corev1.Probe{"startup": c.StartupProbe, "liveness": c.LivenessProbe, "readiness": c.ReadinessProbe} {
					switch {
					case probe == nil:
						t.Errorf("%s has no %s probe", w.name, kind)
					case probe.HTTPGet != nil && !w.hasPort(probe.HTTPGet.Port.StrVal):
						t.Errorf("%s: the %s probe asks port %s", w.name, kind, probe.HTTPGet.Port.String())
					case probe.HTTPGet == nil && probe.Exec == nil:
						t.Errorf("%s: the %s probe asks nothing", w.name, kind)
					}
				}
			}
		}
	})
}

func TestWorkersLeaveInPeaceAndKnowAllCoordinators(t *testing.T) {
	eachRelease(t, func(t *testing.T, r *release) {
		worker := r.workload(t, releaseName+"-worker")
		grace, err := strconv.ParseInt(argument(worker, "--grace"), 10, 64)
		if err != nil {
			t.Fatal(err)
		}
		if killed := *worker.template.Spec.TerminationGracePeriodSeconds; killed <= grace {
			t.Errorf("a worker finishes within %d s and is killed after %d s", grace, killed)
		}
		coordinator := r.workload(t, releaseName+"-coordinator")
		named := strings.Split(argument(worker, "--coordinator"), ",")
		if len(named) != int(*coordinator.replicas) {
			t.Errorf("workers know %v of %d coordinators", named, *coordinator.replicas)
		}
		for i, address := range named {
			want := coordinator.name + "-" + strconv.Itoa(i) + "." + coordinator.name + "." + namespace + ".svc:7070"
			if address != want {
				t.Errorf("workers look for %s; coordinator %d is %s", address, i, want)
			}
		}
	})
}

// argument is the value of an option of a workload's first container.
func argument(w workload, option string) string {
	for _, a := range w.template.Spec.Containers[0].Args {
		if value, found := strings.CutPrefix(a, option+"="); found {
			return value
		}
	}
	return ""
}

func (r *release) workload(t *testing.T, name string) workload {
	t.Helper()
	for _, w := range r.workloads() {
		if w.name == name {
			return w
		}
	}
	t.Fatalf("there is no workload %s", name)
	return workload{}
}
